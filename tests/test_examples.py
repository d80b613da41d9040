"""The examples run, and stay as short as they claim to be."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from simulated_capture import simulated_capture
from small_arm import scene, write_urdf

from easyhecpp.capture.write import RobotSource, write_capture
from easyhecpp.formats.result_file import ResultFile
from easyhecpp.geometry import pose_error

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    simulated = simulated_capture(scene(3), np.random.default_rng(0), name="small")
    urdf = write_urdf(tmp_path / "robot")
    return write_capture(tmp_path / "small", simulated, robot=RobotSource(urdf))


def test_calibrate_a_capture(capture: Path, tmp_path: Path) -> None:
    script = EXAMPLES / "01_calibrate_a_capture.py"
    assert len(script.read_text().splitlines()) <= 35
    done = subprocess.run(
        [sys.executable, str(script), str(capture)],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "verdict: " in done.stdout
    pose = ResultFile.read(tmp_path / "result.json").T_mount_cam
    assert pose is not None
    assert pose_error(pose.array, scene(3).T_base_cam)[0] < 0.02
