"""What the camera of a simulated cell truly sees of the arm: masks, links, depth.

The arm's own outline comes from the reference renderer. Where other things stand in front of it,
pixels are split into 5 x 5 samples that are decided by depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.robot import LinkMesh

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

SUPERSAMPLE = 5


@dataclass(frozen=True, eq=False)
class Truth:
    """One view without noise.

    Attributes:
        coverage: (H, W) share of each pixel that shows the arm, 0 to 1.
        links: (H, W) int16 index of the link at each pixel's centre, -1 where there is none or it
            is hidden.
        depth: (H, W) metres along the optical axis of whatever is there, 0 for the sky.
    """

    coverage: F32
    links: NDArray[np.int16]
    depth: F32

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) pixels of which the visible arm covers more than half."""
        return self.coverage > 0.5

    def link_masks(self, n_links: int) -> NDArray[np.bool_]:
        """(L, H, W) pixels whose centre shows each link."""
        return self.links == np.arange(n_links, dtype=np.int16)[:, None, None]


class TruthRenderer:
    """Draws truths of one cell through one camera.

    Args:
        arm: meshes of the arm's links.
        others: meshes of everything else, movable ones first, in the order of their poses.
        camera: the camera.
    """

    def __init__(self, arm: Sequence[LinkMesh], others: Sequence[LinkMesh], camera: Camera) -> None:
        if camera.is_distorted:
            others = [subdivided(mesh, 0.15) for mesh in others]
        self._arm_meshes = arm
        self._arm = SilhouetteRenderer(arm, camera)
        self._others = SilhouetteRenderer(others, camera)

    def render(self, Ts_cam_link: F64, Ts_cam_other: F64) -> Truth:
        """Draw one view.

        Args:
            Ts_cam_link: (L, 4, 4) poses of the arm's links.
            Ts_cam_other: (M, 4, 4) poses of the other meshes.
        """
        camera = self._arm.camera
        coverage = reference_coverage_compiled(self._arm_meshes, camera, Ts_cam_link, SUPERSAMPLE)
        links = self._arm.visible_links(Ts_cam_link)
        arm_depth = self._arm.depth(Ts_cam_link)
        other_depth = self._others.depth(Ts_cam_other)
        hidden = other_depth < arm_depth
        # On the arm's edge the centre may miss it: compare with the farthest point next to it.
        around = cv2.dilate(np.where(links >= 0, arm_depth, np.float32(0.0)), np.ones((3, 3)))
        concealed = (coverage > 0) & (other_depth < around)
        if concealed.any():
            coverage = self._clipped(coverage, concealed, Ts_cam_link, Ts_cam_other)
        depth = np.minimum(arm_depth, other_depth)
        return Truth(
            coverage,
            np.where(hidden, np.int16(-1), links),
            np.where(np.isfinite(depth), depth, np.float32(0.0)),
        )

    def _clipped(
        self, coverage: F32, concealed: NDArray[np.bool_], Ts_cam_link: F64, Ts_cam_other: F64
    ) -> F32:
        """Take away what is hidden, by samples in the pixels around the hidden ones."""
        near = cv2.dilate(concealed.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        rows, columns = np.nonzero(near)
        top, bottom, left, right = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
        fine = cropped(self._arm.camera, left, top, right, bottom).scaled(SUPERSAMPLE)
        arm = self._arm.with_camera(fine).depth(Ts_cam_link)
        other = self._others.with_camera(fine).depth(Ts_cam_other)
        seen = (arm <= other) & np.isfinite(arm)
        blocks = seen.reshape(bottom - top, SUPERSAMPLE, right - left, SUPERSAMPLE)
        share = blocks.mean(axis=(1, 3), dtype=np.float32)
        result = coverage.copy()
        inside = near[top:bottom, left:right]
        window = result[top:bottom, left:right]
        window[inside] = np.minimum(window, share)[inside]
        return result


def cropped(camera: Camera, left: int, top: int, right: int, bottom: int) -> Camera:
    """The camera of a part of the picture; right and bottom are exclusive."""
    return replace(
        camera,
        width=int(right - left),
        height=int(bottom - top),
        cx=camera.cx - float(left),
        cy=camera.cy - float(top),
    )


def subdivided(mesh: LinkMesh, longest: float) -> LinkMesh:
    """The same surface with no edge longer than ``longest`` metres, for cameras that bend lines."""
    vertices, faces = mesh.vertices, mesh.faces
    while True:
        corners = vertices[faces]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        split = edges.max(axis=1) > longest
        if not split.any():
            return LinkMesh.from_triangles(vertices, faces)
        a, b, c = faces[split].T
        middles = [len(vertices) + k * len(a) + np.arange(len(a)) for k in range(3)]
        ab, bc, ca = middles
        vertices = np.concatenate(
            [vertices] + [(vertices[i] + vertices[j]) / 2 for i, j in ((a, b), (b, c), (c, a))]
        )
        new = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([faces[~split], *(np.column_stack(f) for f in new)])
