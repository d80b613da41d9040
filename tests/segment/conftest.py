from __future__ import annotations

import pytest
from stage import Stage


@pytest.fixture(scope="session")
def stage(tmp_path_factory) -> Stage:
    """A small arm before a camera, a second arm, and a table; every thing has its own colour."""
    return Stage.build(tmp_path_factory.mktemp("stage"))
