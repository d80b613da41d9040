"""Loading a result file's JSON, with errors that say what to do."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from easyhecpp import __version__
from easyhecpp.errors import InputError

_LISTED = 6


def load_json(path: Path) -> dict[str, Any]:
    """Return the file's top-level object; InputError when it is no result of this package."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError("The result file does not exist", where=path) from error
    except IsADirectoryError as error:
        raise InputError(
            "This is a folder, not a result file", where=path, fix="Name the result.json inside it"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError("The result file is not text", where=path, expected="JSON") from error
    except OSError as error:
        raise InputError(f"Cannot read the result file: {error.strerror}", where=path) from error
    try:
        data = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        place = f"{path}, line {error.lineno}, column {error.colno}"
        raise InputError(f"The result file is not JSON: {error.msg}", where=place) from error
    except ValueError as error:
        raise InputError(f"The result file is not JSON: {error}", where=path) from error
    if not isinstance(data, dict) or "schema" not in data:
        raise InputError(
            "This JSON file is not a calibration result",
            where=path,
            expected="the result.json that easyhecpp calibrate writes",
        )
    return data


def _refuse_constant(name: str) -> float:
    raise ValueError(f"it holds {name}, which is not a JSON number")


def check_schema(data: Mapping[str, Any], newest: int, path: Path) -> None:
    """Raise InputError unless ``data["schema"]`` is between 1 and ``newest``."""
    schema = data["schema"]
    if not isinstance(schema, int) or isinstance(schema, bool) or schema < 1:
        raise InputError(
            f"The result file's schema is {schema!r}", where=path, expected=f"the number {newest}"
        )
    if schema > newest:
        package = data.get("package")
        writer = package.get("version") if isinstance(package, dict) else None
        by = f"easyhecpp {writer}" if writer else "a newer easyhecpp"
        raise InputError(
            f"The result file has schema {schema}, written by {by}; easyhecpp {__version__} "
            f"reads up to schema {newest}",
            where=path,
            fix="Upgrade with: pip install --upgrade easyhecpp",
        )


def input_error(error: ValidationError, where: Path | None) -> InputError:
    """Turn pydantic's list of complaints into one readable error."""
    problems = []
    for item in error.errors(include_url=False):
        place = ".".join(str(part) for part in item["loc"])
        text = item["msg"].removeprefix("Value error, ")
        if item["type"] == "extra_forbidden":
            text = "this key is not known"
        problems.append(f"{place}: {text}" if place else text)
    listed = "; ".join(problems[:_LISTED])
    more = f"; and {len(problems) - _LISTED} more" if len(problems) > _LISTED else ""
    return InputError(
        f"The result contradicts itself or its format: {listed}{more}",
        where=where,
        fix=None
        if where is None
        else "Take the file as easyhecpp wrote it; to move a frame, use easyhecpp export",
    )
