"""From images alone, without weights; and the edge stage that any way ends with."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.segment.classical import Backgrounds, calibrate_from_images
from easyhecpp.segment.edges import EdgeRefinement, refine_edges
from easyhecpp.segment.protocols import CaptureMasks, PoseBelief
from easyhecpp.segment.quality import assess_at
from easyhecpp.segment.scene import Scene
from easyhecpp.session.outcome import Outcome, observations_of
from easyhecpp.session.stages import Stages
from easyhecpp.solve import PoseEstimate, SolveConfig
from easyhecpp.solve.consistency import Findings, ViewFinding, solve_consistent
from easyhecpp.solve.reasons import FEW_CONTOUR

FEWEST_VIEWS = 3
"""With fewer views there is no background to tell the arm from."""


def calibrate_classically(
    capture: Capture, stages: Stages, *, config: SolveConfig, edges: bool = True
) -> Outcome:
    """Images, joints, intrinsics and URDF; nothing else.

    Args:
        capture: Views with images.
        stages: Told about the stages.
        config: Settings of the pose optimisation.
        edges: Whether the pose of the edge stage is taken where it is better; else that of the
            masks.

    Raises:
        InputError: A view without an image, or too few views.
        CalibrationError: Nothing moved, or the arm cannot be found.
    """
    without = [view.id for view in capture.views if not view.has_image]
    if without:
        raise InputError(
            f"These views have no image: {', '.join(without)}",
            where=capture.name,
            expected="one image per view, to find the arm in",
            fix="add the images, or leave the rows out of joints.csv",
        )
    with stages.stage("images", "finding the arm in the images (no weights)"):
        found = calibrate_from_images(
            capture.rig,
            capture.camera,
            [view.image for view in capture.views if view.image is not None],
            [view.joints for view in capture.views],
            ids=capture.view_ids,
        )
    estimate = found.estimate if edges else found.before_edges
    belief = PoseBelief(estimate.T_mount_cam, estimate.covariance)
    masks = CaptureMasks(found.masks, belief)
    with stages.stage("check", "checking the views against each other"):
        _, findings = solve_consistent(
            capture.rig,
            capture.camera,
            observations_of(capture, masks),
            [estimate.T_mount_cam],
            replace(config, start_error_px=min(config.start_error_px, 8.0)),
        )
    return Outcome(
        estimate,
        _with_unseen(findings, capture.view_ids),
        masks,
        found.margin,
        found.before_edges if edges else None,
        found.reasons,
        (_edge_note(found.refinement),) if edges else (),
        found.quality,
    )


def _with_unseen(findings: Findings, ids: Sequence[str]) -> Findings:
    """The findings with an entry for every view, those without a mask among them.

    A view gets no mask when the pose puts the arm out of it: it speaks neither for the pose nor
    against it.

    Args:
        findings: Of the views that have a mask.
        ids: Names of all views.
    """
    known = {finding.id: finding for finding in findings.views}
    views = tuple(
        known.get(
            name,
            ViewFinding(
                name,
                True,
                (FEW_CONTOUR,),
                f"View {name} shows nothing of the arm and says nothing.",
            ),
        )
        for name in ids
    )
    return replace(findings, views=views)


def refine_on_edges(
    capture: Capture, outcome: Outcome, stages: Stages, *, without: Collection[str] = ()
) -> Outcome:
    """Fit the contour to the image's own edges, where that is possible and proves better.

    Left out without images, with fewer than three views, or with a camera that moves with the arm.

    Args:
        capture: The views.
        outcome: The pose so far.
        stages: Told about the stage.
        without: Views whose pictures are of no use.
    """
    used = [view.id for view in outcome.estimate.views]
    views = [v for v in capture.views if v.id in used and v.id not in without and v.has_image]
    blind = [name for name in used if name in without]
    still = capture.rig.mount == capture.robot.base_link
    if len(views) < FEWEST_VIEWS or len(views) + len(blind) < len(used) or not still:
        return outcome
    out = set(outcome.findings.inconsistent)
    ignore = {mask.view_id: mask.ignore for mask in outcome.masks.views}
    with stages.stage("edges", "fitting the outline to the images"):
        scene = Scene(capture.rig, capture.camera, [view.joints for view in views])
        images = [view.image for view in views if view.image is not None]
        backgrounds = Backgrounds(scene, images, outcome.estimate.T_mount_cam)
        ids = [view.id for view in views]
        silent = [ignore.get(name) for name in ids]
        refined = refine_edges(
            backgrounds,
            outcome.estimate,
            ids=ids,
            weights=[0.0 if name in out else 1.0 for name in ids],
            ignore=silent,
        )
        quality = assess_at(backgrounds, refined.estimate.T_mount_cam, ids, silent)
    estimate = refined.estimate
    if refined.accepted and blind:
        estimate = _with_blind(estimate, outcome.estimate)
    return replace(
        outcome,
        estimate=estimate,
        before_edges=outcome.estimate,
        notes=(*outcome.notes, _edge_note(refined)),
        quality=quality,
    )


def _edge_note(refined: EdgeRefinement) -> str:
    return f"edges: {refined.reason}"


def _with_blind(estimate: PoseEstimate, start: PoseEstimate) -> PoseEstimate:
    """The edges' estimate with an entry of no weight for the views that they did not see.

    Args:
        estimate: Of the edge stage, for some of the views.
        start: Of the masks, for all of them; its order is kept.
    """
    rows = {view.id: row for row, view in enumerate(estimate.views)}
    views, contours = [], []
    information, vectors = np.zeros((len(start.views), 7, 7)), np.zeros((len(start.views), 7))
    for i, (view, contour) in enumerate(zip(start.views, start.contours, strict=True)):
        row = rows.get(view.id)
        if row is None:
            views.append(replace(view, weight=0.0))
            contours.append(contour)
        else:
            views.append(estimate.views[row])
            contours.append(estimate.contours[row])
            information[i], vectors[i] = estimate.information[row], estimate.vectors[row]
    return replace(
        estimate,
        views=tuple(views),
        contours=tuple(contours),
        information=information,
        vectors=vectors,
    )
