from __future__ import annotations

import json
import sys

import pytest

from easyhecpp import _optional
from easyhecpp.errors import MissingExtraError


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """Three packages on the path: a whole one, one that lacks a dependency, a broken one."""
    (tmp_path / "whole_pkg").mkdir()
    (tmp_path / "whole_pkg" / "__init__.py").write_text("answer = 42\n")
    (tmp_path / "whole_pkg" / "part.py").write_text("answer = 43\n")
    (tmp_path / "lacking_pkg.py").write_text("import no_such_dependency\n")
    (tmp_path / "broken_pkg.py").write_text("raise ImportError('libGL.so.1: cannot open')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    for name in ("whole_pkg", "whole_pkg.part", "lacking_pkg", "broken_pkg"):
        sys.modules.pop(name, None)


def test_require_returns_the_module_itself():
    assert _optional.require("json", "none", "Nothing") is json


@pytest.mark.usefixtures("packages")
def test_require_returns_the_submodule_that_was_named():
    assert _optional.require("whole_pkg.part", "x", "It").answer == 43


def test_an_absent_package_is_answered_with_the_line_to_type():
    with pytest.raises(MissingExtraError) as caught:
        _optional.require("no_such_package.sub", "view", "The 3-D view")
    assert caught.value.package == "no_such_package"
    assert caught.value.reason is None
    assert str(caught.value).startswith("The 3-D view needs the package 'no_such_package', which")
    assert 'pip install "easyhecpp[view]"' in str(caught.value)


@pytest.mark.usefixtures("packages")
@pytest.mark.parametrize(
    ("module", "reason"),
    [
        ("lacking_pkg", "No module named 'no_such_dependency'"),
        ("broken_pkg", "libGL.so.1: cannot open"),
    ],
)
def test_a_package_that_does_not_load_says_why(module, reason):
    with pytest.raises(MissingExtraError) as caught:
        _optional.require(module, "sim", "Simulating")
    assert caught.value.package == module
    assert caught.value.reason == reason


@pytest.mark.usefixtures("packages")
def test_available_looks_without_importing():
    assert _optional.available("whole_pkg")
    assert _optional.available("broken_pkg")
    assert "whole_pkg" not in sys.modules
    assert _optional.available("whole_pkg.part")
    assert not _optional.available("whole_pkg.other")
    assert not _optional.available("no_such_package")
    assert not _optional.available("no_such_package.sub")
