"""``easyhecpp demo``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from easyhecpp.cli.output import progress, say


@dataclass(frozen=True)
class Demo:
    """Calibrate a simulated camera from photo-real pictures alone, and compare with the truth.

    No masks, no weights, no initial guess: path-traced pictures of an arm in a random cell, four
    at joint poses that suit any camera, two at joint poses chosen with what those told.
    """

    out: Path = Path("demo-calibration")
    """Folder for the results."""

    seed: int = 7
    """Another seed is another cell."""

    def run(self, command_line: str) -> int:
        """Simulate, calibrate, compare with the truth."""
        import numpy as np

        from easyhecpp.geometry import pose_error
        from easyhecpp.session.demo import demonstrate
        from easyhecpp.session.save import output_folder, save

        with output_folder(self.out), progress(quiet=False) as tell:
            demo = demonstrate(np.random.default_rng(self.seed), tell, command_line)
            tell("writing the results")
            save(demo.found, self.out)
        truth, found = demo.cell.T_mount_cam, demo.found
        if demo.first is not None:
            metres, radians = pose_error(demo.first.T_mount_cam, truth)
            say(
                f"{len(demo.first.capture.views)} views for a camera that may be anywhere: error "
                f"{1e3 * metres:.2f} mm, {np.degrees(radians):.3f} deg"
            )
        for choice in demo.choices:
            say(f"  next joint pose: {choice}")
        say(f"verdict: {found.result.verdict}")
        for reason in found.result.reasons:
            say(f"  {reason}")
        for name, T in (("true", truth), ("found", found.T_mount_cam)):
            position = "  ".join(f"{v:+.5f}" for v in T[:3, 3])
            say(f"{name + ' camera position [m]':<26} {position}")
        metres, radians = pose_error(found.T_mount_cam, truth)
        say(f"error: {1e3 * metres:.2f} mm, {np.degrees(radians):.3f} deg")
        sigma = found.result.sigma
        if sigma is not None:
            say(f"stated sigma: {sigma.position_mm:.2f} mm, {sigma.rotation_deg:.3f} deg")
        say(f"Look at {self.out / 'report.html'}.")
        return 0
