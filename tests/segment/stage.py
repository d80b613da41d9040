"""A stage of flat colours on which every pixel's truth is known, and stand-ins for the models.

The stand-ins see images only: ``PerfectSam`` returns the whole thing whose colour fills most of a
box, ``AllArms`` every arm in the picture. What the package makes of their answers is its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from easyhecpp.camera import Camera
from easyhecpp.capture import Capture, View
from easyhecpp.geometry import inverse, look_at, make_transform
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.robot import Robot
from easyhecpp.segment import Prompts, ScoredMasks

LINKS = ("base", "shoulder", "upper", "fore", "wrist")
SIZES = {
    "base": (0.24, 0.24, 0.14, 0.07),
    "shoulder": (0.13, 0.2, 0.16, 0.08),
    "upper": (0.1, 0.12, 0.42, 0.21),
    "fore": (0.08, 0.09, 0.36, 0.18),
    "wrist": (0.16, 0.05, 0.14, 0.07),
}
JOINTS = (
    ("base", "shoulder", 0.14, "0 0 1"),
    ("shoulder", "upper", 0.16, "0 1 0"),
    ("upper", "fore", 0.42, "0 1 0"),
    ("fore", "wrist", 0.36, "1 0 0"),
)
POSES = np.array(
    [
        [0.2, 0.5, 0.9, 0.3],
        [-0.9, 0.9, -0.6, 1.0],
        [1.1, -0.3, 1.4, -0.8],
        [-0.3, -0.7, 1.5, 0.2],
        [2.2, 0.8, 0.7, 0.6],
    ]
)
OTHER_POSES = np.array(
    [
        [-1.5, 0.4, 1.2, 0.0],
        [0.6, 0.2, 1.6, 0.7],
        [-0.2, 1.0, 0.3, -0.4],
        [1.9, -0.5, -0.9, 1.1],
        [0.4, 0.9, -1.4, 0.3],
    ]
)
BACKGROUND, TABLE, ARM, OTHER_ARM = 0, 10, 100, 200


def urdf() -> str:
    links = "".join(
        f'<link name="{name}"><visual><origin xyz="0 0 {z}"/><geometry><box size="{x} {y} {h}"/>'
        "</geometry></visual></link>"
        for name, (x, y, h, z) in SIZES.items()
    )
    joints = "".join(
        f'<joint name="{child}_joint" type="revolute"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="0 0 {z}"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for parent, child, z, axis in JOINTS
    )
    return f'<robot name="stick">{links}{joints}</robot>'


@dataclass(frozen=True)
class Stage:
    robot: Robot
    camera: Camera
    T_mount_cam: np.ndarray
    T_base_other: np.ndarray

    @classmethod
    def build(cls, folder: Path) -> Stage:
        path = folder / "stick.urdf"
        path.write_text(urdf())
        camera = Camera(width=320, height=240, fx=300.0, fy=302.0, cx=158.0, cy=121.0)
        return cls(
            Robot.from_urdf(path),
            camera,
            look_at((1.9, -0.7, 1.1), (0.0, 0.0, 0.45)),
            make_transform(np.eye(3), np.array([-0.75, 0.8, 0.0])),
        )

    @property
    def renderer(self) -> SilhouetteRenderer:
        return SilhouetteRenderer(self.robot.meshes, self.camera)

    def Ts_cam_link(self, q, T_base_arm=None):
        T = np.eye(4) if T_base_arm is None else T_base_arm
        return inverse(self.T_mount_cam) @ T @ self.robot.link_poses(q)

    def arm(self, q) -> np.ndarray:
        """(H, W) index of the visible link, -1 for none: the truth."""
        return self.renderer.visible_links(self.Ts_cam_link(q))

    def picture(self, q, other_q=None, table=None) -> np.ndarray:
        """(H, W, 3): background, table (a slice of rows and columns), other arm, arm in front."""
        labels = np.full((self.camera.height, self.camera.width), BACKGROUND, dtype=np.uint8)
        if table is not None:
            labels[table] = TABLE
        if other_q is not None:
            seen = self.renderer.visible_links(self.Ts_cam_link(other_q, self.T_base_other))
            labels[seen >= 0] = OTHER_ARM
        seen = self.arm(q)
        labels[seen >= 0] = ARM + seen[seen >= 0]
        return np.repeat(labels[..., None], 3, axis=2)

    def capture(self, **extras) -> Capture:
        """All poses, with ``extras`` for ``picture``."""
        others = extras.pop("others", [None] * len(POSES))
        views = tuple(
            View(f"{i:04d}", q, image=self.picture(q, other, **extras), mask=self.arm(q) >= 0)
            for i, (q, other) in enumerate(zip(POSES, others, strict=True))
        )
        return Capture("stage", None, "eye-to-hand", self.robot, self.camera, views)


class PerfectSam:
    """Outlines, to the pixel, the things that fill most of a box; counts what it encodes."""

    name = "perfect"

    def __init__(self) -> None:
        self.encoded: list[np.ndarray] = []
        self.asked: list[Prompts] = []

    def encode(self, image):
        self.encoded.append(image)
        return _PerfectImage(self, image[..., 0])


@dataclass
class _PerfectImage:
    sam: PerfectSam
    labels: np.ndarray

    @property
    def size(self):
        return self.labels.shape

    def predict(self, prompts: Prompts) -> ScoredMasks:
        self.sam.asked.append(prompts)
        masks = [self._thing(*np.round(box).astype(int)) for box in prompts.boxes]
        return ScoredMasks(np.stack(masks), np.full(len(masks), 0.9))

    def _thing(self, x0, y0, x1, y1):
        inside = self.labels[y0 : y1 + 1, x0 : x1 + 1]
        counts = np.bincount(inside[inside != BACKGROUND], minlength=256)
        if not counts.any():
            return np.zeros(self.labels.shape, dtype=bool)
        # A box round two links means both of them.
        wanted = np.flatnonzero(counts >= 0.3 * counts.max())
        return np.isin(self.labels, wanted)


class AllArms:
    """Finds every arm in a picture, the wrong one first."""

    name = "all arms"

    def segment(self, image, text):
        assert text == "robot arm"
        labels = image[..., 0]
        arm = (labels >= ARM) & (labels < OTHER_ARM)
        masks = [m for m in (labels == OTHER_ARM, labels == TABLE, arm) if m.any()]
        stacked = np.stack(masks) if masks else np.zeros((0, *labels.shape), dtype=bool)
        return ScoredMasks(stacked, np.linspace(0.9, 0.5, len(masks)))
