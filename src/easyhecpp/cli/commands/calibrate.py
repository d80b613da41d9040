"""``easyhecpp calibrate``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from easyhecpp.cli.output import FAILED, complain, progress, say, say_json, say_verdict
from easyhecpp.cli.pretrained import PretrainedOptions
from easyhecpp.errors import CalibrationError

if TYPE_CHECKING:
    from easyhecpp.formats.result_file import ResultFile
    from easyhecpp.session import CalibrationConfig


@dataclass(frozen=True)
class Calibrate:
    """Find the camera of a capture: pose, uncertainty and verdict.

    Writes result.json, report.html and an overlay of every view into a folder.
    """

    capture: Positional[Path]
    """Folder of the capture: images, joints, intrinsics, robot; masks are optional."""

    out: Path | None = None
    """Folder for the results; the capture's name with "-calibration" in the current folder when
    left out."""

    segmenter: str = "auto"
    """Where masks come from: auto, given, classical, or a pretrained model's name (see
    "easyhecpp segment --help"). auto takes the capture's masks, else weights that are already on
    this disk, else classical. It never downloads."""

    first_pose: Literal["sphere", "paper"] = "sphere"
    """Search for the first pose: all around the arm at any distance, or the paper's grid at 1 m."""

    no_edges: bool = False
    """Leave out the last stage, which fits the outline to the image's own edges."""

    refine: tuple[str, ...] = ()
    """Refine with the pose what may be off: focal, principal_point, lens (k1 and k2), sag, names
    of joints (their zeros). Each may carry how far off it may be, as in focal=0.02 joint4=0.005:
    relative, pixels, of k1, radians or metres. Refused where the views cannot tell it from the
    pose. Unasked, where the outlines show it: a lens stated without distortion and, with edges,
    the arm's sag and the zeros of joints."""

    strict: bool = False
    """Exit with 3 when the result is doubtful."""

    json: bool = False
    """Print the result file instead of a summary."""

    quiet: bool = False
    """No progress on standard error."""

    pretrained: Annotated[PretrainedOptions, arg(name="")] = field(
        default_factory=PretrainedOptions
    )

    def run(self, command_line: str) -> int:
        """Calibrate, write, summarise."""
        from easyhecpp.capture import Capture
        from easyhecpp.session import calibrate
        from easyhecpp.session.save import output_folder, save, save_failure

        out = self.out or Path(f"{self.capture.resolve().name}-calibration")
        with progress(self.quiet) as tell:
            tell("reading the capture")
            capture = Capture.load(self.capture)
            with output_folder(out):
                try:
                    found = calibrate(capture, self._config(), progress=tell, command=command_line)
                except CalibrationError as error:
                    save_failure(capture, error, out, self.segmenter, command_line)
                    complain(f"easyhecpp: {error}")
                    complain(f"Why, and what to do next: {out / 'report.html'}")
                    return FAILED
                tell("writing the results")
                save(found, out)
        if self.json:
            say_json(found.result.model_dump(mode="json", by_alias=True))
        else:
            _summarise(found.result, (*found.capture.notes, *found.notes), out)
        if found.result.verdict == "failed" or (self.strict and found.result.verdict != "ok"):
            return FAILED
        return 0

    def _config(self) -> CalibrationConfig:
        from easyhecpp.session import CalibrationConfig

        return CalibrationConfig(
            segmenter=self.segmenter,
            first_pose=self.first_pose,
            edges=not self.no_edges,
            pretrained=self.pretrained.config(),
            refine=self.refine,
        )


def _summarise(result: ResultFile, notes: tuple[str, ...], out: Path) -> None:
    say_verdict(result, notes)
    pose, sigma = result.T_mount_cam, result.sigma
    if pose is not None:
        say(f"pose of {pose.child} in {pose.parent}:")
        say("  xyz [m]      " + "  ".join(f"{v:+.5f}" for v in pose.xyz_m))
        say("  quat [wxyz]  " + "  ".join(f"{v:+.6f}" for v in pose.quat_wxyz))
    if sigma is not None:
        say(
            f"  sigma        {sigma.position_mm:.2f} mm, {sigma.rotation_deg:.3f} deg at the camera"
            + ("" if sigma.workspace_mm is None else f"; {sigma.workspace_mm:.2f} mm at the arm")
        )
    for parameter in result.refined:
        say(
            f"  refined      {parameter.name} by {parameter.correction:+.5g} "
            f"(sigma {parameter.sigma:.2g}, {parameter.unit})"
        )
    seconds = sum((result.timings_s or {}).values())
    say(f"{len(result.views)} views, {seconds:.1f} s. Written to {out}/")
