from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of a tiny checkpoint by name (``sam``, ``sam2_video``, ...), made on first use."""
    pytest.importorskip("torch", reason="needs the extra 'models'")
    pytest.importorskip("transformers", reason="needs the extra 'models'")
    import tiny_models

    made: dict[str, Path] = {}

    def folder(name: str) -> Path:
        if name not in made:
            save = getattr(tiny_models, f"save_{name}")
            made[name] = save(tmp_path_factory.mktemp("checkpoints") / name)
        return made[name]

    return folder


@pytest.fixture
def picture() -> np.ndarray:
    """A picture that is wider than high, of a size that divides no model's input."""
    return np.random.default_rng(7).integers(0, 256, (45, 77, 3), dtype=np.uint8)
