"""What the images say along the contour of the arm at a pose."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.geometry import inverse
from easyhecpp.render import Contour
from easyhecpp.segment._edge_kernel import AGAINST_PLATE, NONE, find_edges
from easyhecpp.segment._rim_kernel import STEP
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.edge_rim import BLURS_PX, USUAL_BLUR_PX, RimModel
from easyhecpp.segment.scene import Scene

F64 = NDArray[np.float64]

_BLUR_PX = 1.0
"""Of the derivative that edges are looked for with."""

_BLUR_SPACING_PX, _BLUR_REACH_PX, _BLUR_SAMPLES = 4.0, 5.0, 50
"""How the camera's blur is measured: spacing and reach of the samples, and fewest edges."""


@dataclass(frozen=True)
class EdgeReading:
    """What the images say along the contour of one view at one pose; full-size pixels.

    Attributes:
        contour: The samples.
        offset: ``(N,)`` outward displacement of the edge from the sample.
        kind: ``(N,)`` what the edge was found from, 0 for no edge found.
        contrast: ``(N,)`` steepness of the edge, 0..255 per pixel.
        misfit: ``(N,)`` share of the light about an edge against a known background that the model
            of the rim leaves unexplained.
    """

    contour: Contour
    offset: F64
    kind: NDArray[np.int8]
    contrast: F64
    misfit: F64

    @property
    def found(self) -> NDArray[np.bool_]:
        """``(N,)`` whether there is an edge."""
        return self.kind != NONE


@dataclass(frozen=True)
class EdgeSupport:
    """How well the images bear a pose out; the check against wrong poses.

    Attributes:
        share: Share of the contour with an image edge within 1.5 px.
        length_px: Length of the visible contour, all views.
        covered: Share of the image that the arm covers, mean over the views.
        views: Share for each view, nan where no contour is visible.
    """

    share: float
    length_px: float
    covered: float
    views: F64


class EdgeReader:
    """Reads the edges in a set of views along the contour at any pose near the present one.

    Args:
        backgrounds: The pictures and what is behind the arm.
        ignore: Per view ``(H, W)`` bool where the image says nothing, or None.
    """

    def __init__(
        self, backgrounds: Backgrounds, ignore: Sequence[NDArray[np.bool_] | None] | None = None
    ) -> None:
        self.backgrounds = backgrounds
        self.scene = backgrounds.scene
        self.ignore = ignore
        self.rim = RimModel.behind(USUAL_BLUR_PX)
        sigma = _BLUR_PX / STEP
        half = int(np.ceil(2.5 * sigma))
        k = np.arange(-half, half + 1)
        taps = k * np.exp(-0.5 * np.square(k / sigma))
        # Scaled so that a ramp of one unit per pixel gives one.
        self.taps = taps / (np.sum(taps * k) * STEP)

    def with_scene(self, scene: Scene) -> EdgeReader:
        """The same reader, of an arm with other joints or through another lens."""
        other = copy(self)
        other.backgrounds = self.backgrounds.with_scene(scene)
        other.scene = scene
        return other

    def measure_blur(self, T_mount_cam: F64) -> None:
        """Take the camera's blur from the steeper half of the edges near a pose.

        The blur that leaves least of their light unexplained is read with from now on. Where next
        to nothing is found, the usual one stays.
        """
        shown = self.scene.contours(inverse(T_mount_cam), 1, spacing=_BLUR_SPACING_PX)
        unexplained = []
        for model in map(RimModel.behind, BLURS_PX):
            readings = parallel_map(
                lambda view, model=model: self._view(view, *shown[view], _BLUR_REACH_PX, model),
                range(len(self.scene)),
            )
            contrast, misfit = (
                np.concatenate([getattr(r, name)[r.kind == AGAINST_PLATE] for r in readings])
                for name in ("contrast", "misfit")
            )
            if len(contrast) < _BLUR_SAMPLES:
                return
            unexplained.append(float(np.median(misfit[contrast >= np.median(contrast)])))
        best = int(np.clip(np.argmin(unexplained), 1, len(BLURS_PX) - 2))
        around = slice(best - 1, best + 2)
        a, b, _ = np.polyfit(np.log(BLURS_PX[around]), unexplained[around], 2)
        least = float(np.exp(-0.5 * b / a)) if a > 0.0 else BLURS_PX[best]
        self.rim = RimModel.behind(float(np.clip(least, BLURS_PX[0], BLURS_PX[-1])))

    def read(
        self, T_mount_cam: F64, reach_px: float, *, spacing_px: float = 1.0
    ) -> list[EdgeReading]:
        """Edges of all views within ``reach_px`` of the contour at a pose."""
        shown = self.scene.contours(inverse(T_mount_cam), 1, spacing=spacing_px)
        return parallel_map(
            lambda view: self._view(view, *shown[view], reach_px, self.rim),
            range(len(self.scene)),
        )

    def _view(
        self, view: int, contour: Contour, coverage: NDArray[np.float32], reach_px: float,
        rim: RimModel,
    ) -> EdgeReading:  # fmt: skip
        n = len(contour)
        offset, contrast, misfit = np.zeros(n), np.zeros(n), np.zeros(n)
        kind = np.zeros(n, np.int8)
        find_edges(
            self.backgrounds.values[view], self.backgrounds.plates[view],
            (coverage > 0.5).astype(np.uint8), contour.points, contour.normals,
            float(reach_px), self.taps, self.backgrounds.noise,
            rim.shifts, rim.explains, rim.step_width_px,
            offset, contrast, misfit, kind,
        )  # fmt: skip
        ignored = None if self.ignore is None else self.ignore[view]
        if ignored is not None and n:
            x, y = np.round(contour.points).astype(np.int64).T
            kind[ignored[y, x]] = NONE
        return EdgeReading(contour, offset, kind, contrast, misfit)

    def support(self, T_mount_cam: F64) -> EdgeSupport:
        """How well the images bear out a pose."""
        readings = self.read(T_mount_cam, 4.0, spacing_px=2.0)
        near = [r.found & (np.abs(r.offset) < 1.5) for r in readings]
        total = sum(len(n) for n in near)
        covers = self.scene.coverages(inverse(T_mount_cam), 8)
        return EdgeSupport(
            share=float(sum(n.sum() for n in near)) / max(total, 1),
            length_px=2.0 * total,
            covered=float(covers.mean()),
            views=np.array([float(n.mean()) if len(n) else np.nan for n in near]),
        )
