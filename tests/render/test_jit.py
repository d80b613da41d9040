"""Where compiled code is kept: never that of other sources, and nothing breaks without a place."""

from __future__ import annotations

import ast
import importlib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from easyhecpp.render import _jit as jit_module
from easyhecpp.render._jit import KERNEL_FILES, source_digest

PACKAGE = Path(jit_module.__file__).parents[1]


@pytest.fixture
def numba_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit_module.numba_config, "CACHE_DIR", "")


# Whose code it is


def test_every_file_with_compiled_code_is_named() -> None:
    users = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if "import jit" in path.read_text() or "import numba" in path.read_text()
    }
    assert users <= set(KERNEL_FILES)
    assert all((PACKAGE / name).is_file() for name in KERNEL_FILES)


@pytest.mark.parametrize("file", KERNEL_FILES)
def test_compiled_code_takes_nothing_from_other_files(file: str) -> None:
    """A constant is compiled in: one from a file that is not named could go stale."""
    module = importlib.import_module("easyhecpp." + file[:-3].replace("/", "."))
    compiled = [f for f in vars(module).values() if isinstance(f, Dispatcher)]
    used = {name for f in compiled for name in f.py_func.__code__.co_names}
    for node in ast.walk(ast.parse((PACKAGE / file).read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("easyhecpp."):
            source = str(node.module).removeprefix("easyhecpp.").replace(".", "/") + ".py"
            names = {alias.asname or alias.name for alias in node.names}
            assert source in KERNEL_FILES or not names & used


def test_the_digest_changes_with_every_kernel(tmp_path: Path) -> None:
    for name in KERNEL_FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(PACKAGE / name, tmp_path / name)
    digests = {source_digest(tmp_path)}
    assert digests == {source_digest(PACKAGE)}
    for name in KERNEL_FILES:
        with (tmp_path / name).open("a") as file:
            file.write("\n")
        digests.add(source_digest(tmp_path))
    assert len(digests) == 1 + len(KERNEL_FILES)


def test_a_changed_callee_in_another_file_is_compiled_anew(tmp_path: Path) -> None:
    """A package of two kernels, one of which calls the other, that is changed between two runs."""
    package, cache = tmp_path / "small", tmp_path / "cache"
    render = package / "render"
    render.mkdir(parents=True)
    for folder in (package, render):
        (folder / "__init__.py").touch()
    shutil.copy(jit_module.__file__, render)
    callee, caller = render / "_project.py", render / "_depth_kernel.py"
    header = "from small.render._jit import jit\n"
    caller.write_text(
        f"{header}from small.render._project import f\n@jit\ndef g(x):\n    return f(x)\n"
    )

    def run(factor: int) -> int:
        callee.write_text(f"{header}@jit\ndef f(x):\n    return {factor} * x\n")
        done = subprocess.run(
            [sys.executable, "-c", "from small.render._depth_kernel import g; print(g(21))"],
            capture_output=True, text=True, check=True, cwd=tmp_path,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(tmp_path)},
        )  # fmt: skip
        return int(done.stdout)

    assert run(2) == 42
    first = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?")}
    assert run(3) == 63
    folders = list(cache.iterdir())
    assert len(folders) == 2
    assert all(len(list(folder.rglob("*.nbi"))) == 2 for folder in folders)
    # The second run wrote into none of the first one's files, and the first one's still serve.
    assert first == {path: path.stat().st_mtime_ns for path in first}
    assert run(2) == 42
    assert first == {path: path.stat().st_mtime_ns for path in first}


# Where it is kept


def test_beside_the_package_when_that_can_be_written(
    numba_cache: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(jit_module, "_PACKAGE", tmp_path)
    folder = jit_module._cache_folder()
    assert folder is not None
    assert folder.parent == tmp_path / "__pycache__"
    assert source_digest(tmp_path) in folder.name


def test_under_the_temporary_folder_otherwise(
    numba_cache: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    writable = jit_module._writable
    monkeypatch.setattr(jit_module.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(
        jit_module, "_writable", lambda folder: tmp_path in folder.parents and writable(folder)
    )
    folder = jit_module._cache_folder()
    assert folder is not None
    assert folder.parents[1] == tmp_path
    assert folder.parent.stat().st_mode & 0o777 == 0o700


def test_in_the_configured_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(jit_module.numba_config, "CACHE_DIR", str(tmp_path / "mine"))
    folder = jit_module._cache_folder()
    assert folder is not None
    assert folder.parent == tmp_path / "mine"


def test_a_configured_folder_that_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(jit_module.numba_config, "CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(jit_module.tempfile, "gettempdir", lambda: str(tmp_path))
    folder = jit_module._cache_folder()
    assert folder is not None
    assert folder.parents[1] == tmp_path


def test_other_packages_keep_their_own_folder() -> None:
    before = jit_module.numba_config.CACHE_DIR
    jit_module.jit(lambda x: x)
    assert before == jit_module.numba_config.CACHE_DIR


def test_what_was_not_used_for_long_goes_when_something_new_comes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(jit_module.numba_config, "CACHE_DIR", str(tmp_path))
    old, recent, foreign = (
        tmp_path / name
        for name in ("easyhecpp-kernels-" + "0" * 16, "easyhecpp-kernels-" + "1" * 16, "other")
    )
    for folder, days in ((old, 40), (recent, 20), (foreign, 40)):
        folder.mkdir()
        (folder / "code.nbc").touch()
        os.utime(folder, (time.time() - days * 86400,) * 2)
    current = jit_module._cache_folder()
    assert current is not None
    assert {p.name for p in tmp_path.iterdir()} == {recent.name, foreign.name, current.name}
    # Used again after long: it is not old.
    os.utime(current, (0, 0))
    assert jit_module._cache_folder() == current
    jit_module._remove_unused(tmp_path)
    assert current.is_dir()


@pytest.mark.skipif(
    not hasattr(os, "getuid"), reason="files have no owners on this system (Windows)"
)
def test_never_somebody_elses_folder(
    numba_cache: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(jit_module.tempfile, "gettempdir", lambda: str(tmp_path))
    mine = os.getuid()
    (tmp_path / f"easyhecpp-numba-{mine + 1}").mkdir()
    monkeypatch.setattr(jit_module.os, "getuid", lambda: mine + 1)
    assert jit_module._private_temporary_folder() is None


def test_none_at_all(tmp_path: Path) -> None:
    """No folder can be written: the renderer's kernels still compile and work."""
    (tmp_path / "file").write_text("")
    blocked = tmp_path / "file" / "cache"
    script = (
        "import tempfile\n"
        f"tempfile.gettempdir = lambda: {str(blocked)!r}\n"
        f"tempfile.TemporaryFile = lambda dir: open({str(blocked)!r}, 'w')\n"
        "from easyhecpp.render import _jit\n"
        "assert not _jit.CACHE\n"
        "twice = _jit.jit(lambda x: 2 * x)\n"
        "print(twice(21))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(blocked)}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["42"]
