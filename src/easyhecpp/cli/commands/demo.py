"""``easyhecpp demo``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from easyhecpp.cli.output import progress, say


@dataclass(frozen=True)
class Demo:
    """Calibrate a simulated camera from photo-real pictures alone, and compare with the truth.

    No masks, no weights, no initial guess: six path-traced pictures of an arm in a random cell.
    """

    out: Path = Path("demo-calibration")
    """Folder for the results."""

    seed: int = 7
    """Another seed is another cell."""

    def run(self, command_line: str) -> int:
        """Simulate, calibrate, compare with the truth."""
        import numpy as np

        from easyhecpp.geometry import pose_error
        from easyhecpp.session import CalibrationConfig, calibrate
        from easyhecpp.session.demo import photographed_capture
        from easyhecpp.session.save import output_folder, save

        with output_folder(self.out), progress(quiet=False) as tell:
            capture, cell = photographed_capture(np.random.default_rng(self.seed), tell)
            found = calibrate(
                capture,
                CalibrationConfig(segmenter="classical"),
                progress=tell,
                command=command_line,
            )
            tell("writing the results")
            save(found, self.out)
        metres, radians = pose_error(found.T_mount_cam, cell.T_mount_cam)
        sigma = found.result.sigma
        truth, pose = cell.T_mount_cam[:3, 3], found.T_mount_cam[:3, 3]
        say(f"verdict: {found.result.verdict}")
        for reason in found.result.reasons:
            say(f"  {reason}")
        say("true camera position [m]   " + "  ".join(f"{v:+.5f}" for v in truth))
        say("found camera position [m]  " + "  ".join(f"{v:+.5f}" for v in pose))
        say(f"error: {1e3 * metres:.2f} mm, {np.degrees(radians):.3f} deg")
        if sigma is not None:
            say(f"stated sigma: {sigma.position_mm:.2f} mm, {sigma.rotation_deg:.3f} deg")
        say(f"Look at {self.out / 'report.html'}.")
        return 0
