from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples every time, and no limit on the time that one takes: a busy machine is no bug.
settings.register_profile("repository", derandomize=True, deadline=None)
settings.load_profile("repository")

_BESIDE_THE_REPOSITORY = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder with the real captures and reference material, which the repository does not hold."""
    folder = Path(os.environ.get("EASYHECPP_SHARED", _BESIDE_THE_REPOSITORY))
    if not folder.is_dir():
        pytest.skip(
            "needs the shared folder with the real captures: put it beside the repository, "
            "or name it in EASYHECPP_SHARED"
        )
    return folder


@pytest.fixture
def lock(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Take the right to look into a folder, or to read a file, away.

    By hand, because permissions mean nothing to the superuser, as whom containers run tests.
    """
    locked: list[Path] = []
    stat, iterdir, open_file = Path.stat, Path.iterdir, Path.open

    def refuse(path: Path, *closed: Path) -> None:
        if any(place in locked for place in closed):
            raise PermissionError(13, "Permission denied", str(path))

    def locked_stat(path: Path, **options: bool) -> os.stat_result:
        refuse(path, *path.parents)
        return stat(path, **options)

    def locked_iterdir(path: Path) -> Iterator[Path]:
        refuse(path, path, *path.parents)
        return iterdir(path)

    def locked_open(path: Path, *arguments: object, **options: object) -> object:
        refuse(path, path, *path.parents)
        return open_file(path, *arguments, **options)  # type: ignore[call-overload]

    monkeypatch.setattr(Path, "stat", locked_stat)
    monkeypatch.setattr(Path, "iterdir", locked_iterdir)
    monkeypatch.setattr(Path, "open", locked_open)
    return locked.append
