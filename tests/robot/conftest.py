from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def robots_folder() -> Path:
    """Robot descriptions of the wheel `example-robot-data`."""
    distribution = importlib.metadata.distribution("example-robot-data")
    return Path(
        str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots"))
    ).resolve()


@pytest.fixture(autouse=True)
def private_cache(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Keep the tests out of the user's cache folder, and blind to the user's ROS."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


@pytest.fixture
def write_urdf(tmp_path: Path) -> Callable[[str], Path]:
    """Write the inside of a `<robot>` element to a file."""

    def write(body: str) -> Path:
        path = tmp_path / "robot.urdf"
        path.write_text(f'<?xml version="1.0"?>\n<robot name="test">\n{body}\n</robot>\n')
        return path

    return write
