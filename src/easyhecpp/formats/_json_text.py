"""JSON as this package writes it: readable by people, the same bytes for the same content."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from datetime import datetime
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np

_WIDTH = 100


def json_text(value: Any) -> str:
    """Return ``value`` as indented JSON, keys in their given order, ending in a newline.

    Lists without keys inside stay on one line as long as they fit, so that a matrix is one row a
    line. Floats are written with the fewest digits that read back to the same double.

    Raises:
        ValueError: A number is not finite; JSON has no spelling for it.
    """
    return _lines(value, "") + "\n"


def plain(value: Any) -> Any:
    """Turn configuration into what JSON can hold.

    Dataclasses become objects; tuples, sets and arrays become lists; paths and enums become
    strings; a number that is not finite becomes its name, ``"inf"`` or ``"nan"``.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, (set, frozenset)):
        return sorted(plain(item) for item in value)
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value) if isinstance(value, PurePath) else repr(value)


def _lines(value: Any, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, Mapping) and value:
        items = [f"{inner}{json.dumps(str(k))}: {_lines(v, inner)}" for k, v in value.items()]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    flat = json.dumps(value, allow_nan=False)
    if not isinstance(value, (list, tuple)) or not value:
        return flat
    rows = any(isinstance(item, (list, tuple, Mapping)) for item in value)
    if not rows and len(indent) + len(flat) <= _WIDTH:
        return flat
    if not rows and all(isinstance(item, (int, float)) for item in value):
        return flat
    return "[\n" + ",\n".join(inner + _lines(item, inner) for item in value) + f"\n{indent}]"
