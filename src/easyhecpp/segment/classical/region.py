"""Moves a pose until the contour parts what looks like arm from what looks like background."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map
from easyhecpp.geometry import inverse, perturb_about
from easyhecpp.render import Contour
from easyhecpp.segment.classical.lines import line_posteriors
from easyhecpp.segment.scene import Scene

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

EvidenceMaker = Callable[[F32], list[F32]]
"""From the coverage of all views ``(V, H, W)`` to the evidence of each view ``(H, W)``."""

_STRENGTH = 3.0
_FEWEST_SAMPLES = 30


@dataclass(frozen=True)
class Round:
    """One pass of the region stage; pixels of its own size.

    Attributes:
        reach: Displacement looked at along the normals.
        scale: Displacement at which a sample has a quarter of its say.
        steps: Most steps.
        bracketed: Whether a line must see arm and background to count.
    """

    reach: int
    scale: float
    steps: int
    bracketed: bool = False


@dataclass(frozen=True)
class Displacements:
    """What the region evidence says along one view's contour; pixels of the level.

    Attributes:
        contour: The samples.
        mean: ``(N,)`` outward displacement.
        weight: ``(N,)`` its information, 0 where nothing is known.
    """

    contour: Contour
    mean: F64
    weight: F64


def displacements(
    scene: Scene,
    T_cam_mount: F64,
    reduction: int,
    make: EvidenceMaker,
    settings: Round,
    *,
    coarse: bool = False,
) -> list[Displacements]:
    """Read the evidence along all contours at a pose."""
    shown = scene.contours(T_cam_mount, reduction, spacing=1.0, coarse=coarse)
    evidence = make(np.stack([coverage for _, coverage in shown]))

    def one(view: int) -> Displacements:
        contour, coverage = shown[view]
        mean, weight = np.empty(len(contour)), np.empty(len(contour))
        line_posteriors(
            evidence[view], coverage, contour.points, contour.normals,
            settings.reach, _STRENGTH, 0.6 * settings.reach, settings.bracketed, mean, weight,
        )  # fmt: skip
        return Displacements(contour, mean, weight)

    return parallel_map(one, range(len(scene)))


def fit_regions(
    scene: Scene,
    T_mount_cam: F64,
    reduction: int,
    make: EvidenceMaker,
    rounds: Sequence[Round],
) -> F64:
    """Robust Gauss-Newton on the displacements of all views.

    Args:
        scene: The arm.
        T_mount_cam: ``(4, 4)`` start.
        reduction: Size of the evidence.
        make: Makes the evidence from the coverage at the present pose.
        rounds: From far to near.

    Returns:
        ``(4, 4)`` T_mount_cam; the start where too little of the arm is seen.
    """
    T = inverse(T_mount_cam)
    for settings in rounds:
        for _ in range(settings.steps):
            read = displacements(scene, T, reduction, make, settings)
            step, moved = _step(read, settings)
            if step is None:
                break
            T = perturb_about(T, scene.centre_cam(T), step)
            if moved < 0.05:
                break
    return inverse(T)


def _step(read: Sequence[Displacements], settings: Round) -> tuple[F64 | None, float]:
    """The step ``(6,)`` and how far it moves the contours, root mean square pixels."""
    J = np.concatenate([d.contour.jacobians for d in read])
    m = np.concatenate([d.mean for d in read])
    w = np.concatenate([d.weight for d in read])
    if np.count_nonzero(w) < _FEWEST_SAMPLES:
        return None, 0.0
    w = w / np.square(1.0 + np.square(m / settings.scale))
    H = J.T @ (w[:, None] * J)
    H[np.diag_indices(6)] *= 1.0 + 1e-3
    H[np.diag_indices(6)] += 1e-9 * np.trace(H)
    step = np.linalg.solve(H, J.T @ (w * m))
    moved = float(np.sqrt(np.mean(np.square(J @ step))))
    # Beyond its own reach the lines have not looked.
    limit = 1.5 * settings.scale
    if moved > limit:
        step, moved = step * (limit / moved), limit
    return step, moved
