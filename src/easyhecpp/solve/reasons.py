"""Why a view does not belong to the pose of the others, in a word and in a sentence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from easyhecpp.geometry import pose_error
from easyhecpp.solve.agreement import Agreement, pixel_unit, refit_camera, refit_joints
from easyhecpp.solve.problem import PoseProblem

F64 = NDArray[np.float64]

FEW_CONTOUR = "few-contour"
"""Flag of a view that shows next to nothing of the arm, whether it agrees or not."""

FEW_CONTOUR_PX = 60.0
"""Length of visible contour, at an image width of 1280 px, under which a view says little."""

_HIDDEN = 0.4
_REDUCTION = 4


def reason_for(
    problem: PoseProblem, view: int, T_cam_mount: F64, here: Agreement, typical: float
) -> tuple[str, str]:
    """Flag and sentence for a view that disagrees.

    Args:
        problem: All views.
        view: Which.
        T_cam_mount: Pose of the views that agree.
        here: Agreement of all views with it.
        typical: Mismatch (1 - IoU) of the views that agree.
    """
    name = problem.observations[view].id or str(view)
    if here.contour_px[view] < FEW_CONTOUR_PX * pixel_unit(problem):
        return FEW_CONTOUR, (
            f"View {name} shows almost no outline of the arm where the others expect it. Leave it "
            "out, or take it again with the arm in the picture."
        )
    lacking, extra = _areas(problem, view, T_cam_mount)
    good = 1.6 * typical + 0.025
    own, T_own = refit_camera(problem, view, T_cam_mount)
    moved = refit_joints(problem, view, T_cam_mount)
    by_camera, by_joints = float(own.mismatch[0]), float(moved.mismatch[0])
    explained = by_joints < good or by_joints < 0.4 * float(here.mismatch[view])
    if explained and by_joints < 1.3 * by_camera:
        return "moving", (
            f"View {name}: the arm in the picture stands a little differently from the joints on "
            "record. Was it moving when the picture was taken, or do the joints belong to another "
            "picture? Let the arm come to rest and take the view again."
        )
    if by_camera < good:
        shift, turn = pose_error(T_own, np.linalg.inv(T_cam_mount))
        return "camera-moved", (
            f"View {name} fits a camera that stands {1e3 * shift:.0f} mm and "
            f"{np.degrees(turn):.1f} deg elsewhere. Did the camera or the robot's foot move? Take "
            "the view again."
        )
    if lacking > _HIDDEN and extra < 0.1:
        return "hidden", (
            f"View {name}: {lacking:.0%} of the arm is missing from the mask. Something stands in "
            "front of the arm, or the mask lost it. Check the mask or take the view again."
        )
    wrong = (
        f"{extra:.0%} of the mask lies outside of the arm"
        if extra > lacking
        else f"{lacking:.0%} of the arm is missing from the mask"
    )
    return "mask", (
        f"View {name}: {wrong}. Look at its mask: a link may be missing, or something else be "
        "taken for the arm. Correct the mask or take the view again."
    )


def _areas(problem: PoseProblem, view: int, T_cam_mount: F64) -> tuple[float, float]:
    """Share of the rendered arm that the mask lacks, and share of the mask beyond the arm."""
    rendered = problem.renderer(_REDUCTION).coverage(T_cam_mount @ problem.Ts_mount_link[view])
    level = problem.masks[view].level(_REDUCTION)
    mask = level.mask
    if level.usable is not None:
        rendered, mask = rendered * level.usable, mask * level.usable
    both = float(np.minimum(rendered, mask).sum())
    return (
        1.0 - both / max(float(rendered.sum()), 1e-6),
        1.0 - both / max(float(mask.sum()), 1e-6),
    )
