"""Which pictures of a capture a calibration may use, before any is segmented."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from easyhecpp._parallel import parallel_map
from easyhecpp.capture import Capture
from easyhecpp.capture.health import FrameStatistics, HealthFinding, health_findings
from easyhecpp.capture.still_camera import Backdrop, CameraMoves, camera_moves
from easyhecpp.capture.view import View
from easyhecpp.errors import CalibrationError, InputError
from easyhecpp.formats.result_blocks import ViewResult
from easyhecpp.solve.consistency import ViewFinding

UNUSABLE = "unusable-image"
"""Flag of a view whose picture shows nothing, or not this view."""


@dataclass(frozen=True)
class Screening:
    """What the pictures of a capture are fit for.

    Attributes:
        left_out: The views whose pictures cannot be used, and why.
        doubts: Reasons to doubt any pose from these pictures, sentences.
        notes: What the user should know about the pictures, sentences.
    """

    left_out: tuple[ViewFinding, ...] = ()
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def unusable(self) -> tuple[str, ...]:
        """Ids of the views that are left out."""
        return tuple(finding.id for finding in self.left_out)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is said of the views that are left out, one by one."""
        return tuple(finding.sentence for finding in self.left_out if finding.sentence)

    def usable(self, capture: Capture, fewest: int) -> Capture:
        """The capture without the views that are left out.

        Args:
            capture: With all views.
            fewest: Views that have to remain.

        Raises:
            InputError: Fewer remain.
        """
        if not self.left_out:
            return capture
        kept = [view for view in capture.view_ids if view not in self.unusable]
        if len(kept) < fewest:
            raise InputError(
                f"Only {len(kept)} of {len(capture.views)} views have an image that can be used",
                where="; ".join(note.rstrip(".") for note in self.notes),
                expected=f"at least {fewest}",
                fix="record the others again, or add views",
            )
        return capture.subset(kept)

    def with_left_out(
        self, capture: Capture, views: Sequence[ViewResult]
    ) -> tuple[ViewResult, ...]:
        """The views that took part and the ones left out, in the capture's order."""
        known = {view.id: view for view in views}
        out = {f.id: ViewResult(id=f.id, weight=0.0, flags=f.flags) for f in self.left_out}
        return tuple((out | known)[name] for name in capture.view_ids if name in out | known)

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """A context in which a failed calibration also says what is wrong with the pictures."""
        try:
            yield
        except CalibrationError as error:
            said = " ".join((*self.doubts, *self.notes))
            raise (CalibrationError(f"{error} {said}") if said else error) from error


def screen_for_edges(capture: Capture) -> Screening:
    """Look at all pictures of a capture that comes with masks.

    Pictures that cannot be used are left to the edge stage to leave out; the masks may well be
    right, and it is they that the verdict rests on.

    Raises:
        InputError: An image cannot be read.
    """
    found = _screened(capture, _findings(capture))
    return Screening(tuple(replace(f, sentence="") for f in found.left_out), notes=found.notes)


def screen_for_masks(capture: Capture) -> Screening:
    """Look at all pictures of a capture, from which masks are to be made.

    Raises:
        InputError: No image can be used, or one cannot be read.
    """
    findings = _findings(capture)
    hopeless = [finding for finding in findings if finding.hopeless]
    if hopeless:
        raise InputError(
            "; ".join(finding.text for finding in hopeless),
            where=capture.name,
            expected="images in which the arm stands as the joints say, to find it in",
            fix=hopeless[0].fix,
        )
    return _screened(capture, findings)


def _findings(capture: Capture) -> list[HealthFinding]:
    def statistics(view: View) -> FrameStatistics | None:
        return None if view.image is None else FrameStatistics.of(view.id, view.joints, view.image)

    found = parallel_map(statistics, capture.views)
    return health_findings([frame for frame in found if frame is not None])


def _screened(capture: Capture, findings: Sequence[HealthFinding]) -> Screening:
    left_out = {
        view: ViewFinding(
            view, False, (UNUSABLE,), f"View {view} is left out: {why}. Take it again."
        )
        for finding in findings
        for view, why in finding.unusable.items()
    }
    notes = [f"{finding.text}. {finding.fix}." for finding in findings]
    moves = _moves(capture, without=left_out)
    if moves.moved:
        notes.append(f"{moves.text}.")
    for view, pixels in moves.moved.items():
        sentence = (
            f"View {view} is left out: the camera moved by about {pixels:.0f} px, against the "
            "other views. Fix the camera and take the view again."
        )
        left_out[view] = ViewFinding(
            view, False, ("camera-moved",), "" if moves.for_good else sentence
        )
    doubts = ()
    if moves.for_good:
        doubts = (
            f"{moves.text}. The pose is that of the camera in the others. Fix the camera and "
            "record again.",
        )
    return Screening(tuple(left_out.values()), doubts, tuple(notes))


def _moves(capture: Capture, without: dict[str, ViewFinding]) -> CameraMoves:
    """Displacements of the background; none where the camera is meant to move."""
    if capture.rig.mount != capture.robot.base_link:
        return CameraMoves({}, len(capture.views))
    backdrops = []
    for view in capture.views:
        if view.id not in without and view.image is not None:
            backdrops.append(Backdrop.of(view.id, view.image))
    return camera_moves(backdrops)


def restored(whole: Capture, part: Capture) -> Capture:
    """A capture of which some views were worked on, with all of its views again."""
    known = {view.id: view for view in part.views}
    return replace(part, views=tuple(known.get(view.id, view) for view in whole.views))
