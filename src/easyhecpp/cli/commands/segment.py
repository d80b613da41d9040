"""``easyhecpp segment``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from easyhecpp.cli.output import FAILED, progress, say, say_verdict
from easyhecpp.cli.pretrained import PretrainedOptions


@dataclass(frozen=True)
class Segment:
    """Make the arm's masks from the images and write them, with a page to judge them by.

    Segmenters: classical (no weights), or pretrained pairs of a text and a box model: grounded-sam
    (the paper's), grounded-sam-large, grounded-sam-base, grounded-sam2, grounded-sam2-tiny,
    grounded-sam-hq, sam3 (gated weights); or a box model alone (sam, sam2, sam-hq), for which the
    classical way finds the first pose.
    """

    capture: Positional[Path]
    """Folder of the capture."""

    out: Path = Path("segmentation")
    """Folder for masks/, overlays/ and masks.html."""

    segmenter: str = "auto"
    """One of the names above; auto takes weights that are on this disk, else classical."""

    quiet: bool = False
    """No progress on standard error."""

    pretrained: Annotated[PretrainedOptions, arg(name="")] = field(
        default_factory=PretrainedOptions
    )

    def run(self, command_line: str) -> int:
        """Segment, write, and say whether the masks can be trusted."""
        from easyhecpp.capture import Capture
        from easyhecpp.session import CalibrationConfig, calibrate
        from easyhecpp.session.masks import segmenter_for_images
        from easyhecpp.session.save import MASKS_PAGE, output_folder, save_masks

        with progress(self.quiet) as tell:
            tell("reading the capture")
            capture = Capture.load(self.capture)
            pretrained = self.pretrained.config()
            segmenter = segmenter_for_images(self.segmenter, pretrained)
            with output_folder(self.out):
                found = calibrate(
                    capture,
                    CalibrationConfig(segmenter=segmenter, pretrained=pretrained),
                    progress=tell,
                    command=command_line,
                )
                tell("writing the masks")
                written = save_masks(found, self.out)
        say_verdict(found.result, (*capture.notes, *found.notes))
        say(f"{len(written)} of {len(capture.views)} masks written to {self.out / 'masks'}/")
        say(f"Look at {self.out / MASKS_PAGE}")
        return FAILED if found.result.verdict == "failed" else 0
