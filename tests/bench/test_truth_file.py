from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from easyhecpp.bench.truth_file import read_truth
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3

T = exp_se3(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))


def written(folder: Path, content: Any) -> Path:
    (folder / "truth.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(
    "content",
    [
        {"T_mount_cam": {"parent": "base", "child": "cam", "matrix": T.tolist()}},
        {"T_mount_cam": T.tolist()},
        {"T_base_cam": T.tolist()},
    ],
)
def test_a_pose(tmp_path: Path, content: Any):
    truth = read_truth(written(tmp_path, content))
    np.testing.assert_array_equal(truth.T_mount_cam, T)
    assert truth.other is None


def test_a_stereo_pair(tmp_path: Path):
    right = tmp_path / "right"
    right.mkdir()
    written(right, {"stereo": {"other": "../left", "T_other_cam": T.tolist()}})
    truth = read_truth(right)
    assert truth.T_mount_cam is None
    assert truth.other == (tmp_path / "left").resolve()
    np.testing.assert_array_equal(truth.T_other_cam, T)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "Names no pose"),
        ([1], "Holds no object"),
        ({"T_base_cam": [[1, 2], [3]]}, "T_base_cam is not a rigid transform"),
        ({"T_base_cam": (2 * T).tolist()}, "T_base_cam is not a rigid transform"),
        ({"T_base_cam": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "not a rigid transform"),
        ({"stereo": {"other": "../left"}}, "stereo.T_other_cam is not a rigid transform"),
    ],
)
def test_what_is_no_truth(tmp_path: Path, content: Any, words: str):
    with pytest.raises(InputError, match=words):
        read_truth(written(tmp_path, content))


def test_no_file_and_no_json(tmp_path: Path):
    with pytest.raises(InputError, match="no such file"):
        read_truth(tmp_path)
    (tmp_path / "truth.json").write_text("{")
    with pytest.raises(InputError, match="Cannot be read"):
        read_truth(tmp_path)
