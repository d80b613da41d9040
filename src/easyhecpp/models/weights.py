"""Getting a model's weights: a folder of the user's, the Hugging Face cache, or a download.

Every adapter loads from a local folder; whatever can go wrong before that is said here, once.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from easyhecpp._optional import require
from easyhecpp.errors import InputError
from easyhecpp.models.checkpoint import (
    CLASSICAL,
    DOWNLOADED,
    PICKLED,
    WeightsSpec,
    check_checkpoint,
    find,
    has_weights,
    is_hub_name,
    on_disk,
    problem,
)

_log = logging.getLogger(__name__)

_Absent = Mapping[str, Sequence[WeightsSpec]]  # names on the hub, and the models that want them


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
    (folder,) = fetch([(spec, spec.default if weights is None else weights)])
    check_checkpoint(spec, folder, weights)
    return folder


def fetch(wanted: Sequence[tuple[WeightsSpec, str | Path]]) -> list[Path]:
    """The local folders of several models' weights; one error names all that cannot be had.

    Args:
        wanted: models, and for each a folder or a name on the hub.

    Raises:
        InputError: no such folder or name; weights that are gated or not to be had.
        MissingExtraError: something must be downloaded and huggingface_hub is not installed.
    """
    absent: dict[str, list[WeightsSpec]] = {}
    for spec, weights in wanted:
        folder = Path(weights).expanduser()
        if not folder.is_dir() and not is_hub_name(weights):
            raise InputError(
                f"there is no folder {str(weights)!r} with weights for {spec.model}",
                expected=f"a folder, or a name on the Hugging Face hub such as {spec.default}",
                fix=f"to make such a folder: {spec.fetch_command()}",
            )
        if not folder.is_dir() and on_disk(spec, weights) is None:
            absent.setdefault(str(weights), []).append(spec)
    downloaded = {}
    for name in list(absent):
        downloaded[name] = _download(name, absent)
        del absent[name]
    return [downloaded.get(str(weights)) or find(weights) or Path(weights) for _, weights in wanted]


def offline() -> bool:
    """Whether ``HF_HUB_OFFLINE`` or ``TRANSFORMERS_OFFLINE`` switches the hub off."""
    switches = (os.environ.get(k, "") for k in ("HF_HUB_OFFLINE", "TRANSFORMERS_OFFLINE"))
    return any(value.strip().upper() in ("1", "ON", "YES", "TRUE") for value in switches)


def _download(name: str, absent: _Absent) -> Path:
    """Download one of the weights that are absent."""
    if offline():
        raise _not_to_be_had(absent, "the hub is switched off by HF_HUB_OFFLINE")
    spec = absent[name][0]
    hub = require("huggingface_hub", "models", f"The model {spec.model}")
    errors = require("huggingface_hub.errors", "models", f"The model {spec.model}")
    _log.warning("downloading the weights %s of %s", name, spec.model)
    try:
        folder = Path(hub.snapshot_download(name, allow_patterns=list(DOWNLOADED)))
        if not has_weights(folder):
            folder = Path(hub.snapshot_download(name, allow_patterns=[*DOWNLOADED, PICKLED]))
    except errors.GatedRepoError as error:
        raise _gated(name, absent) from error
    except errors.RepositoryNotFoundError as error:
        if spec.gated and name == spec.default:
            raise _gated(name, absent) from error
        raise InputError(
            f"the Hugging Face hub has no model {name!r}, or shows it to no one without a login",
            expected=f"a name such as {spec.default}, or a folder with weights",
            fix=f"check the spelling, or `hf auth login`. {CLASSICAL}",
        ) from error
    except Exception as error:  # proxies, sockets, http, xet, disks: each with errors of its own
        raise _not_to_be_had(absent, first_line(error)) from error
    return folder


def _not_to_be_had(absent: _Absent, reason: str) -> InputError:
    many = len(absent) > 1
    options = dict.fromkeys(spec.option for specs in absent.values() for spec in specs)
    gated = any(spec.gated for specs in absent.values() for spec in specs)
    login = " (gated: accept the licence on the model's page and `hf auth login` first)"
    return InputError(
        f"the weights {' and '.join(_described(n, specs[0]) for n, specs in absent.items())} "
        f"are not on this disk and cannot be fetched: {reason}",
        expected="weights in the Hugging Face cache or in a folder",
        fix=f"On a machine with network run {_commands(absent)}{login if gated else ''}, copy the "
        f"folder{'s' if many else ''} here and give {'them' if many else 'it'} as "
        f"{' and '.join(options)}. {CLASSICAL}",
    )


def _gated(name: str, absent: _Absent) -> InputError:
    return InputError(
        f"the weights {_described(name, absent[name][0])} are gated: the hub hands them out only "
        "to accounts that have accepted their licence",
        expected="a login whose access request was granted",
        fix=f"Ask for access on https://huggingface.co/{name}, then `hf auth login` and "
        f"{_commands(absent)}. {CLASSICAL}",
    )


def _described(name: str, spec: WeightsSpec) -> str:
    """Weights in an error's words, with what is missing where a part is there."""
    folder = find(name)
    lacks = None if folder is None else problem(spec, folder)
    return f"{name} of {spec.model}" + (f" (in the cache, but {lacks})" if lacks else "")


def _commands(absent: _Absent) -> str:
    return " and ".join(f"`{specs[0].fetch_command(name)}`" for name, specs in absent.items())


def first_line(error: Exception) -> str:
    """The first line of an error's text without its full stop, or its kind where it has none."""
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else type(error).__name__
