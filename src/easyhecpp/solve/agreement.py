"""How far every view is from agreeing with a pose; cheap, on reduced images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp.geometry import inverse
from easyhecpp.solve.descend import Level, descend
from easyhecpp.solve.evidence import Evidence
from easyhecpp.solve.joint_twists import by_joints, joint_twists
from easyhecpp.solve.problem import PoseProblem

F64 = NDArray[np.float64]

REDUCTION = 2
"""Size reduction at which views are compared: fine enough for a pixel, cheap enough for many."""

_JOINT_SCALES_PX = (80.0, 80.0, 80.0, 40.0, 40.0, 20.0, 20.0, 10.0, 10.0, 5.0, 5.0, 3.0, 3.0)
_JOINT_PRIOR = 0.3
"""Standard deviation of how far a joint may have moved before its picture was taken, rad or m."""


@dataclass(frozen=True)
class Agreement:
    """Distance of views from a pose.

    Attributes:
        distance_px: ``(V,)`` median distance of the rendered contour from the mask's outline.
        far: ``(V,)`` share of the contour farther off than the 4 px (at 1280 px of width) that
            no segmenter's boundary wanders.
        mismatch: ``(V,)`` one minus the intersection over union.
        contour_px: ``(V,)`` length of contour in the image.
    """

    distance_px: F64
    far: F64
    mismatch: F64
    contour_px: F64


def pixel_unit(problem: PoseProblem) -> float:
    """Pixels of the image that one pixel of a 1280 px wide one amounts to, at least a half."""
    return max(0.5, max(problem.camera.width, problem.camera.height) / 1280.0)


def look(problem: PoseProblem, T_cam_mount: F64) -> list[Evidence]:
    """Compare the views with a pose."""
    return problem.gather(T_cam_mount, REDUCTION, smoothing_px=0.0, spacing=1.0)


def agreement(problem: PoseProblem, T_cam_mount: F64) -> Agreement:
    """How the views agree with a pose."""
    return summary(look(problem, T_cam_mount), pixel_unit(problem))


def summary(seen: Sequence[Evidence], unit: float) -> Agreement:
    """Sum up what was seen, view by view."""
    apart = [np.abs(e.distances) for e in seen]
    return Agreement(
        distance_px=np.array([float(np.median(d)) if len(d) else np.inf for d in apart]),
        far=np.array([float(np.mean(d > 4.0 * unit)) if len(d) else 1.0 for d in apart]),
        mismatch=np.array([1.0 - e.iou for e in seen]),
        contour_px=np.array([len(e.distances) * e.length for e in seen]),
    )


def settle(problem: PoseProblem, T_cam_mount: F64, wide_px: float) -> F64:
    """The pose ``T_cam_mount`` that fits a few views best, on reduced images."""
    for scale in (wide_px, 4.0):
        T_cam_mount = descend(
            problem, T_cam_mount, Level(4, scale_px=scale, spacing=1.0), 10
        ).T_cam_mount
    return descend(problem, T_cam_mount, Level(REDUCTION), 6).T_cam_mount


def subproblem(problem: PoseProblem, views: Sequence[int]) -> PoseProblem:
    """The same masks, fewer of them."""
    return PoseProblem(
        problem.rig,
        problem.camera,
        [problem.observations[v] for v in views],
        [problem.masks[v] for v in views],
    )


def with_joints(problem: PoseProblem, view: int, joints: F64) -> PoseProblem:
    """One view with other joint values."""
    observation = problem.observations[view]
    moved = type(observation)(joints, observation.mask, observation.ignore, 1.0, observation.id)
    return PoseProblem(problem.rig, problem.camera, [moved], [problem.masks[view]])


def refit_joints(problem: PoseProblem, view: int, T_cam_mount: F64) -> Agreement:
    """How well a view agrees once its joints may differ from what was recorded."""
    recorded = problem.observations[view].joints
    joints = recorded.copy()
    unit = pixel_unit(problem)
    best: Agreement | None = None
    for scale in _JOINT_SCALES_PX:
        alone = with_joints(problem, view, joints)
        (e,) = look(alone, T_cam_mount)
        now = summary([e], unit)
        if best is None or now.mismatch[0] < best.mismatch[0]:
            best = now
        if not len(e.distances):
            break
        twists = joint_twists(problem.rig, joints, T_cam_mount, alone.centre_cam(T_cam_mount))
        J = by_joints(e.jacobians, e.contour.links, twists)
        weight = e.length / np.square(1.0 + np.square(e.distances / (scale * unit)))
        H = J.T @ (weight[:, None] * J) + np.eye(len(joints)) * 4.0 * unit / _JOINT_PRIOR**2
        g = J.T @ (weight * e.distances) - 4.0 * unit / _JOINT_PRIOR**2 * (joints - recorded)
        joints = joints + np.linalg.solve(H, g)
    assert best is not None
    return best


def refit_camera(problem: PoseProblem, view: int, T_cam_mount: F64) -> tuple[Agreement, F64]:
    """How well a view agrees once it has a camera pose of its own, and that ``T_mount_cam``."""
    alone = subproblem(problem, [view])
    T = settle(alone, T_cam_mount, 20.0)
    return agreement(alone, T), inverse(T)
