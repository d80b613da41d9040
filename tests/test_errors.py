from __future__ import annotations

import pickle

import pytest

from easyhecpp.errors import (
    CalibrationError,
    EasyHecError,
    InputError,
    MissingExtraError,
    NothingSuitsError,
)


def test_input_error_reads_as_sentences():
    error = InputError(
        "Column 'joint8' is no joint of the robot",
        where="joints.csv, line 1",
        expected="joint1 to joint7",
        fix="Rename the column, or list the joint in default_joints",
    )
    assert str(error) == (
        "Column 'joint8' is no joint of the robot (joints.csv, line 1). "
        "Expected: joint1 to joint7. "
        "Rename the column, or list the joint in default_joints."
    )
    assert error.what == "Column 'joint8' is no joint of the robot"
    assert error.where == "joints.csv, line 1"
    assert error.expected == "joint1 to joint7"
    assert error.fix.startswith("Rename")


def test_input_error_leaves_out_what_is_not_given_and_doubles_no_full_stop():
    assert str(InputError("The mask is empty.")) == "The mask is empty."
    assert str(InputError("The mask is empty.", where="0003.png")) == (
        "The mask is empty (0003.png)."
    )
    assert str(InputError("Is that a robot?", fix="Try again!")) == "Is that a robot? Try again!"


def test_missing_extra_error_carries_the_line_to_type():
    error = MissingExtraError("transformers", "models", "Segmenting with SAM 2")
    assert str(error) == (
        "Segmenting with SAM 2 needs the package 'transformers', which is not installed. "
        'Install it with: pip install "easyhecpp[models]"'
    )


def test_missing_extra_error_tells_a_broken_package_from_an_absent_one():
    error = MissingExtraError("mitsuba", "sim", "Simulating", reason="libLLVM.so: not found")
    assert "which does not load (libLLVM.so: not found)" in str(error)


@pytest.mark.parametrize(
    "error",
    [
        InputError("a", where="b", expected="c", fix="d"),
        NothingSuitsError("a", where="b", expected="c", fix="d"),
        MissingExtraError("a", "b", "c", "d"),
        CalibrationError("No view shows the arm"),
    ],
)
def test_errors_share_one_base_and_survive_a_trip_between_processes(error):
    assert isinstance(error, EasyHecError)
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert vars(back) == vars(error)


def test_a_missing_extra_is_an_import_error_and_bad_input_is_not_a_bug():
    assert issubclass(MissingExtraError, ImportError)
    assert not issubclass(InputError, ImportError)
