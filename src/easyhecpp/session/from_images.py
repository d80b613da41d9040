"""From images alone, without weights; and the edge stage that any way ends with."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from easyhecpp.capture import Capture
from easyhecpp.errors import InputError
from easyhecpp.segment.classical import Backgrounds, calibrate_from_images
from easyhecpp.segment.classical.masks import NO_ARM
from easyhecpp.segment.classical.segmenter import FEWEST_VIEWS
from easyhecpp.segment.edges import EdgeRefinement, refine_edges
from easyhecpp.segment.protocols import CaptureMasks, PoseBelief, ViewMask
from easyhecpp.segment.quality import assess_at
from easyhecpp.segment.scene import Scene
from easyhecpp.session.outcome import Outcome, observations_of
from easyhecpp.session.refinement import Refined, add_corrections, corrected_by
from easyhecpp.session.stages import Stages
from easyhecpp.solve import PoseEstimate, SolveConfig
from easyhecpp.solve.consistency import Findings, ViewFinding, retested, solve_consistent
from easyhecpp.solve.reasons import FEW_CONTOUR
from easyhecpp.solve.strains import Strain
from easyhecpp.solve.types import ContourFit, ViewFit

_NO_RIVAL = 1.0
"""Of overlap with the masks; rivals in explaining the changes are among the reasons for doubt."""


def calibrate_classically(
    capture: Capture, stages: Stages, *, config: SolveConfig, edges: bool = True
) -> Refined:
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
    corrections: tuple[Strain, ...] = ()
    if edges:
        capture = corrected_by(capture, found.refinement)
        corrections = found.refinement.corrections
    belief = PoseBelief(estimate.T_mount_cam, estimate.covariance)
    masks = CaptureMasks(found.masks, belief)
    with stages.stage("check", "checking the views against each other"):
        findings = _findings(capture, masks, estimate, config)
    outcome = Outcome(
        _in_order(estimate, capture.view_ids),
        _with_unseen(findings, found.masks),
        masks,
        _NO_RIVAL,
        _in_order(found.before_edges, capture.view_ids) if edges else None,
        found.reasons,
        (_edge_note(found.refinement),) if edges else (),
        found.quality,
    )
    return Refined(capture, outcome, corrections)


def _with_unseen(findings: Findings, masks: Sequence[ViewMask]) -> Findings:
    """The findings with an entry for every view, those without a mask among them.

    A view gets no mask when the pose puts the arm out of it: it speaks neither for the pose nor
    against it. A view whose picture should show the arm and does not speaks against it.

    Args:
        findings: Of the views that have a mask.
        masks: One per view.
    """
    known = {finding.id: finding for finding in findings.views}
    views = tuple(known.get(mask.view_id) or _unseen(mask) for mask in masks)
    return replace(findings, views=views)


def _unseen(mask: ViewMask) -> ViewFinding:
    """What is said of a view without a mask."""
    name = mask.view_id
    if NO_ARM not in mask.notes:
        sentence = f"View {name} shows nothing of the arm and says nothing."
        return ViewFinding(name, True, (FEW_CONTOUR,), sentence)
    return ViewFinding(
        name,
        False,
        ("hidden",),
        f"View {name} does not show the arm where the others expect it. Check that its joints "
        "belong to its picture and that nothing hides the arm, or take the view again.",
    )


def refine_on_edges(
    refined: Refined, stages: Stages, *, config: SolveConfig, without: Collection[str] = ()
) -> Refined:
    """Fit the contour to the image's own edges, where that is possible and proves better.

    Left out without images, with fewer than three views, or with a camera that moves with the arm.

    Args:
        refined: The views and the pose so far.
        stages: Told about the stage.
        config: Settings of the pose optimisation.
        without: Views whose pictures are of no use.
    """
    capture, outcome = refined.capture, refined.outcome
    used = [view.id for view in outcome.estimate.views]
    views = [v for v in capture.views if v.id in used and v.id not in without and v.has_image]
    blind = [name for name in used if name in without]
    still = capture.rig.mount == capture.robot.base_link
    if len(views) < FEWEST_VIEWS or len(views) + len(blind) < len(used) or not still:
        return refined
    out = set(outcome.findings.inconsistent)
    ignore = {mask.view_id: mask.ignore for mask in outcome.masks.views}
    with stages.stage("edges", "fitting the outline to the images"):
        scene = Scene(capture.rig, capture.camera, [view.joints for view in views])
        images = [view.image for view in views if view.image is not None]
        backgrounds = Backgrounds(scene, images, outcome.estimate.T_mount_cam)
        ids = [view.id for view in views]
        silent = [ignore.get(name) for name in ids]
        found = refine_edges(
            backgrounds,
            outcome.estimate,
            ids=ids,
            weights=[0.0 if name in out else 1.0 for name in ids],
            ignore=silent,
        )
        quality = assess_at(
            backgrounds.with_scene(found.scene), found.estimate.T_mount_cam, ids, silent
        )
        capture, corrections = corrected_by(capture, found), found.corrections
        findings = outcome.findings
        if corrections and (out or findings.searched or findings.contradictory):
            findings = _findings(capture, outcome.masks, found.estimate, config)
        elif corrections:
            findings = retested(
                findings,
                capture.rig,
                capture.camera,
                observations_of(capture, outcome.masks),
                found.estimate.T_mount_cam,
            )
    outcome = replace(
        outcome,
        estimate=_in_order(found.estimate, used, outcome.estimate),
        findings=findings,
        before_edges=outcome.estimate,
        notes=(*outcome.notes, _edge_note(found)),
        quality=quality,
    )
    return replace(
        refined,
        capture=capture,
        outcome=outcome,
        corrections=add_corrections(refined.corrections, corrections),
    )


def _findings(
    capture: Capture, masks: CaptureMasks, estimate: PoseEstimate, config: SolveConfig
) -> Findings:
    """How the views' masks agree with each other, from a pose that is all but right."""
    near = replace(config, start_error_px=min(config.start_error_px, 8.0))
    seen = observations_of(capture, masks)
    return solve_consistent(capture.rig, capture.camera, seen, [estimate.T_mount_cam], near)[1]


def _edge_note(refined: EdgeRefinement) -> str:
    return f"edges: {refined.reason}"


def _in_order(
    estimate: PoseEstimate, ids: Sequence[str], before: PoseEstimate | None = None
) -> PoseEstimate:
    """An estimate with an entry for every view; of no weight for those that it did not see.

    Args:
        estimate: For some of the views.
        ids: All of them, in their order.
        before: What is known of the others from an earlier stage, if anything.
    """
    rows = {view.id: row for row, view in enumerate(estimate.views)}
    if list(rows) == list(ids):
        return estimate
    earlier = {} if before is None else dict(_fits(before))
    now = dict(_fits(estimate))
    views, contours = [], []
    information, vectors = np.zeros((len(ids), 7, 7)), np.zeros((len(ids), 7))
    for i, name in enumerate(ids):
        if name in now:
            view, contour = now[name]
            information[i] = estimate.information[rows[name]]
            vectors[i] = estimate.vectors[rows[name]]
        else:
            view, contour = earlier.get(name, _nothing(name))
            view = replace(view, weight=0.0)
        views.append(view)
        contours.append(contour)
    return replace(
        estimate,
        views=tuple(views),
        contours=tuple(contours),
        information=information,
        vectors=vectors,
    )


def _fits(estimate: PoseEstimate) -> Iterator[tuple[str, tuple[ViewFit, ContourFit]]]:
    for view, contour in zip(estimate.views, estimate.contours, strict=True):
        yield view.id, (view, contour)


def _nothing(name: str) -> tuple[ViewFit, ContourFit]:
    """The fit of a view without any outline."""
    none = np.zeros(0)
    return (
        ViewFit(
            name, weight=0.0, rms_px=0.0, iou=float("nan"), contour_px=0.0, outliers=0.0,
            outlier_px=0.0, noise_px=0.0,
        ),
        ContourFit(
            np.zeros((0, 2)), np.zeros((0, 2)), none, none, none, np.zeros((0, 6)),
            np.zeros(0, np.int32),
        ),
    )  # fmt: skip
