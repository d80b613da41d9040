from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from capture_folder import CaptureFolder


@pytest.fixture
def folder(tmp_path: Path) -> CaptureFolder:
    return CaptureFolder(tmp_path / "demo")


@pytest.fixture
def make_folder(tmp_path: Path) -> Callable[..., CaptureFolder]:
    def make(name: str, **options: object) -> CaptureFolder:
        return CaptureFolder(tmp_path / name, **options)  # type: ignore[arg-type]

    return make
