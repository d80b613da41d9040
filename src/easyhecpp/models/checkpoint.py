"""What belongs to a checkpoint, and whether all of it is on this disk; nothing here downloads."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from easyhecpp._optional import available, require
from easyhecpp.errors import InputError

CLASSICAL = "Or use --segmenter classical, which needs no weights"

DOWNLOADED = ("*.json", "*.safetensors", "*.txt")
"""What is fetched of a repository: not the .bin and .pt copies of the same weights."""

PICKLED = "pytorch_model*.bin"
"""Fetched, too, of a repository that has its weights in no other form."""

_WEIGHT_FILES = ("model.safetensors", "pytorch_model.bin")
_INDICES = tuple(f"{file}.index.json" for file in _WEIGHT_FILES)  # name the parts of a split file
_VOCABULARIES = (("tokenizer.json",), ("vocab.txt",), ("vocab.json", "merges.txt"))
_HUB_NAME = re.compile(r"\w[\w.-]*/[\w.-]+")


@dataclass(frozen=True)
class WeightsSpec:
    """The weights of one model.

    Attributes:
        model: the model, as a user calls it.
        default: name on the Hugging Face hub.
        model_types: ``model_type`` entries of ``config.json`` that this model can load.
        gated: whether the hub hands the weights out only to those who accepted a licence there.
        option: the command-line option that names other weights for this model.
        tokenizer: whether the model reads text, with the tokenizer that lies beside its weights.
    """

    model: str
    default: str
    model_types: tuple[str, ...]
    gated: bool = False
    option: str = "--box-weights"
    tokenizer: bool = False

    def fetch_command(self, weights: str | Path | None = None) -> str:
        """The shell command that puts weights into a folder that can be carried around.

        Args:
            weights: a name on the hub; None, or a folder, stands for the model's default.
        """
        repo = str(weights) if weights and is_hub_name(weights) else self.default
        owner, _, name = repo.rpartition("/")
        # Whoever published the default also published safetensors; of others nobody knows.
        others = () if owner == self.default.rpartition("/")[0] else (PICKLED,)
        wanted = " ".join(f"--include '{pattern}'" for pattern in (*DOWNLOADED, *others))
        return f"hf download {repo} {wanted} --local-dir {name}"


def is_hub_name(weights: str | Path) -> bool:
    """Whether weights are named as on the Hugging Face hub, and no folder is called so."""
    name = str(weights)
    return bool(_HUB_NAME.fullmatch(name)) and not Path(name).is_dir()


def find(weights: str | Path) -> Path | None:
    """The folder of weights on this disk, whole or not: the user's, or in the Hugging Face cache.

    Args:
        weights: a folder, or a name on the Hugging Face hub.
    """
    folder = Path(weights).expanduser()
    if folder.is_dir():
        return folder
    if not is_hub_name(weights) or not available("huggingface_hub"):
        return None
    hub = require("huggingface_hub", "models", "Looking for weights")
    config = hub.try_to_load_from_cache(str(weights), "config.json")
    return Path(config).parent if isinstance(config, str) else None


def on_disk(spec: WeightsSpec, weights: str | Path) -> Path | None:
    """The folder of weights of which everything that the model needs is on this disk.

    Args:
        spec: the model.
        weights: a folder, or a name on the Hugging Face hub.
    """
    folder = find(weights)
    return None if folder is None or _lacks(spec, folder) else folder


def problem(spec: WeightsSpec, folder: Path) -> str | None:
    """Why a folder holds no whole checkpoint of this model; None when it does."""
    if not (folder / "config.json").is_file():
        return "it has no config.json"
    config = _read_object(folder / "config.json")
    if config is None:
        return "its config.json is not a JSON object"
    model_type = config.get("model_type")
    if model_type not in spec.model_types:
        return f"its config.json names the model type {model_type!r}, not {spec.model_types[0]!r}"
    return _lacks(spec, folder)


def check_checkpoint(spec: WeightsSpec, folder: Path, weights: str | Path | None = None) -> None:
    """Raises InputError unless a folder holds a whole checkpoint of this model.

    Args:
        spec: the model.
        folder: the folder.
        weights: what the user called it; None for the model's default.
    """
    found = problem(spec, folder)
    if found is not None:
        raise InputError(
            f"the folder holds no checkpoint of {spec.model}: {found}",
            where=folder,
            expected=f"what `{spec.fetch_command(weights)}` puts there",
            fix=f"name the right folder, or fetch the weights again. {CLASSICAL}",
        )


def has_weights(folder: Path) -> bool:
    """Whether a folder holds weights in any form, or at least the list of their parts."""
    return any((folder / file).is_file() for file in (*_WEIGHT_FILES, *_INDICES))


def preprocessor_settings(folder: Path) -> dict[str, Any]:
    """What a checkpoint says about its image processor; empty when it says nothing.

    Raises:
        InputError: a file that is not JSON; means or deviations that are not three numbers.
    """
    settings: dict[str, Any] = {}
    for file in ("preprocessor_config.json", "processor_config.json"):
        if not (folder / file).is_file():
            continue
        content = _read_object(folder / file)
        if content is None:
            raise _bad_settings(folder / file, "it is not a JSON object")
        if file.startswith("processor"):
            content = content.get("image_processor")
        found = content if isinstance(content, dict) else {}
        for key, least in (("image_mean", -math.inf), ("image_std", 0.0)):
            if found.get(key) is not None and not _three_numbers(found[key], least):
                raise _bad_settings(folder / file, f"its {key} is {found[key]!r}")
        settings.update(found)
    return settings


def _three_numbers(value: Any, above: float) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(v, (int, float)) and above < v < math.inf for v in value)
    )


def _bad_settings(file: Path, reason: str) -> InputError:
    return InputError(
        f"the settings of the image processor cannot be used: {reason}",
        where=file,
        expected="a JSON object; image_mean and image_std, if any, three numbers each, "
        "and deviations above zero",
        fix="fetch the file again from where the weights came from",
    )


def _lacks(spec: WeightsSpec, folder: Path) -> str | None:
    """What of a model's files is not in a folder; None when all are."""
    if not (folder / "config.json").is_file():
        return "it has no config.json"
    if not _weights_complete(folder):
        return "it has no model.safetensors, or lacks a part of it"
    if spec.tokenizer and not any(all((folder / f).is_file() for f in v) for v in _VOCABULARIES):
        # Without these, transformers makes a tokenizer that knows no word, and says nothing.
        return f"its tokenizer is missing ({' or '.join(' + '.join(v) for v in _VOCABULARIES)})"
    return None


def _weights_complete(folder: Path) -> bool:
    """Whether a folder holds a whole set of weight files; an index names the parts of its set."""
    if any((folder / file).is_file() for file in _WEIGHT_FILES):
        return True
    for file in _INDICES:
        index = _read_object(folder / file) if (folder / file).is_file() else None
        parts = (index or {}).get("weight_map")
        if isinstance(parts, dict) and parts:
            return all((folder / str(part)).is_file() for part in set(parts.values()))
    return False


def _read_object(path: Path) -> dict[str, Any] | None:
    """The JSON object in a file; None when it holds no such thing."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None
