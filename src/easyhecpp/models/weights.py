"""Finding a model's weights: a folder of the user's, the Hugging Face cache, or a download.

Every adapter loads from a local folder; whatever can go wrong before that is said here, once.
"""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from easyhecpp._optional import available, require
from easyhecpp.errors import InputError

_log = logging.getLogger(__name__)

_WEIGHT_FILES = (
    "model.safetensors",
    "model.safetensors.index.json",
    "pytorch_model.bin",
    "pytorch_model.bin.index.json",
)
_DOWNLOADED = ("*.json", "*.safetensors", "*.txt")  # not the .bin and .pt copies of the same
_HUB_NAME = re.compile(r"[\w.-]+/[\w.-]+")
_CLASSICAL = "Or use --segmenter classical, which needs no weights"


@dataclass(frozen=True)
class WeightsSpec:
    """The weights of one model.

    Attributes:
        model: the model, as a user calls it.
        default: name on the Hugging Face hub.
        model_types: ``model_type`` entries of ``config.json`` that this model can load.
        gated: whether the hub hands the weights out only to those who accepted a licence there.
        option: the command-line option that names other weights for this model.
    """

    model: str
    default: str
    model_types: tuple[str, ...]
    gated: bool = False
    option: str = "--box-weights"

    def fetch_command(self, name: str | None = None) -> str:
        """The shell command that puts the weights into a folder that can be carried around."""
        repo = name or self.default
        wanted = " ".join(f"--include '{pattern}'" for pattern in _DOWNLOADED)
        return f"hf download {repo} {wanted} --local-dir {repo.rpartition('/')[2]}"


def resolve(spec: WeightsSpec, weights: str | Path | None = None) -> Path:
    """The local folder of a model's weights; downloads them when that is allowed and needed.

    Args:
        spec: the model.
        weights: a folder, or another name on the hub; None for the model's default.

    Returns:
        A folder with ``config.json`` and the weights.

    Raises:
        InputError: no such folder or name, a folder that is no checkpoint of this model, weights
            that are gated, or that are neither on this disk nor to be had (offline).
        MissingExtraError: the weights are not a folder and huggingface_hub is not installed.
    """
    name = spec.default if weights is None else str(weights)
    folder = Path(name).expanduser()
    if folder.is_dir():
        check_checkpoint(spec, folder)
        return folder
    if not _HUB_NAME.fullmatch(name) or name.startswith("."):
        raise InputError(
            f"there is no folder {name!r} with weights for {spec.model}",
            expected=f"a folder, or a name on the Hugging Face hub such as {spec.default}",
            fix=f"to make such a folder: {spec.fetch_command()}",
        )
    cached = on_disk(name)
    if cached is None:
        cached = _download(spec, name)
    check_checkpoint(spec, cached)
    return cached


def on_disk(name: str | Path) -> Path | None:
    """The folder of weights that are complete on this disk; never touches the network.

    Args:
        name: a folder, or a name on the Hugging Face hub.
    """
    folder = Path(name).expanduser()
    if folder.is_dir():
        return folder if _weights_complete(lambda file: _in_folder(folder, file)) else None
    if not _HUB_NAME.fullmatch(str(name)) or not available("huggingface_hub"):
        return None
    hub = require("huggingface_hub", "models", "Looking for weights")

    def in_cache(file: str) -> Path | None:
        found = hub.try_to_load_from_cache(str(name), file)
        return Path(found) if isinstance(found, str) else None

    config = in_cache("config.json")
    return config.parent if config and _weights_complete(in_cache) else None


def check_checkpoint(spec: WeightsSpec, folder: Path) -> None:
    """Raises InputError unless a folder holds a checkpoint of this model."""
    problem = _checkpoint_problem(spec, folder)
    if problem is not None:
        raise InputError(
            f"the folder holds no checkpoint of {spec.model}: {problem}",
            where=folder,
            expected=f"what `{spec.fetch_command()}` puts there",
            fix=f"name the right folder, or fetch the weights again. {_CLASSICAL}",
        )


def preprocessor_settings(folder: Path) -> dict[str, Any]:
    """What a checkpoint says about its image processor; empty when it says nothing."""
    plain = _read_json(folder / "preprocessor_config.json")
    nested = _read_json(folder / "processor_config.json").get("image_processor")
    return {**plain, **(nested if isinstance(nested, dict) else {})}


def offline() -> bool:
    """Whether ``HF_HUB_OFFLINE`` or ``TRANSFORMERS_OFFLINE`` switches the hub off."""
    switches = (os.environ.get(k, "") for k in ("HF_HUB_OFFLINE", "TRANSFORMERS_OFFLINE"))
    return any(value.strip().upper() in ("1", "ON", "YES", "TRUE") for value in switches)


def _download(spec: WeightsSpec, name: str) -> Path:
    if offline():
        raise _not_to_be_had(spec, name, "the hub is switched off by HF_HUB_OFFLINE")
    hub = require("huggingface_hub", "models", f"The model {spec.model}")
    errors = require("huggingface_hub.errors", "models", f"The model {spec.model}")
    _log.warning("downloading the weights %s of %s", name, spec.model)
    try:
        return Path(hub.snapshot_download(name, allow_patterns=list(_DOWNLOADED)))
    except errors.GatedRepoError as error:
        raise _gated(spec, name) from error
    except errors.RepositoryNotFoundError as error:
        if spec.gated and name == spec.default:
            raise _gated(spec, name) from error
        raise InputError(
            f"the Hugging Face hub has no model {name!r}, or shows it to no one without a login",
            expected=f"a name such as {spec.default}, or a folder with weights",
            fix=f"check the spelling, or `hf auth login`. {_CLASSICAL}",
        ) from error
    except (OSError, RuntimeError, ValueError) as error:  # the many ways in which a network fails
        raise _not_to_be_had(spec, name, _first_line(error)) from error


def _not_to_be_had(spec: WeightsSpec, name: str, reason: str) -> InputError:
    gated = " (gated: accept the licence on the model's page and `hf auth login` first)"
    return InputError(
        f"the weights {name} of {spec.model} are not on this disk and cannot be fetched: {reason}",
        expected="weights in the Hugging Face cache or in a folder",
        fix=f"On a machine with network run `{spec.fetch_command(name)}`"
        f"{gated if spec.gated else ''}, copy the folder here and give it as {spec.option}. "
        f"{_CLASSICAL}",
    )


def _gated(spec: WeightsSpec, name: str) -> InputError:
    return InputError(
        f"the weights {name} of {spec.model} are gated: the hub hands them out only to accounts "
        "that have accepted their licence",
        expected="a login whose access request was granted",
        fix=f"Ask for access on https://huggingface.co/{name}, then `hf auth login` and "
        f"`{spec.fetch_command(name)}`. {_CLASSICAL}",
    )


def _checkpoint_problem(spec: WeightsSpec, folder: Path) -> str | None:
    if not (folder / "config.json").is_file():
        return "it has no config.json"
    try:
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        model_type = config.get("model_type")
    except (ValueError, AttributeError):
        return "its config.json is not a JSON object"
    if model_type not in spec.model_types:
        return f"its config.json names the model type {model_type!r}, not {spec.model_types[0]!r}"
    if not _weights_complete(lambda file: _in_folder(folder, file)):
        return "it has no model.safetensors, or lacks a part of it"
    return None


def _weights_complete(find: Callable[[str], Path | None]) -> bool:
    """Whether a whole set of weight files can be found; an index names the parts of its set."""
    if find("config.json") is None:
        return False
    for file in _WEIGHT_FILES:
        path = find(file)
        if path is None:
            continue
        if not file.endswith(".index.json"):
            return True
        parts = set(_read_json(path).get("weight_map", {}).values())
        if parts and all(find(part) is not None for part in parts):
            return True
    return False


def _in_folder(folder: Path, file: str) -> Path | None:
    path = folder / file
    return path if path.is_file() else None


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else type(error).__name__
