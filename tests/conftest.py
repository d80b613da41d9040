from __future__ import annotations

import os
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
