"""Loading a transformers model from a folder, and refusing one that is not whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from easyhecpp._optional import require
from easyhecpp.errors import InputError
from easyhecpp.models.runtime import Runtime
from easyhecpp.models.weights import WeightsSpec, resolve

if TYPE_CHECKING:
    import torch

# One matrix under two names in all of the SAM family. transformers 4 saved it under one of them,
# and transformers 5 does not tie the two for SAM 2 and SAM 3. Nothing else may be missing.
_SAME_TENSOR = (
    "prompt_encoder.shared_embedding.positional_embedding",
    "shared_image_embedding.positional_embedding",
)
_VOCABULARIES = ("tokenizer.json", "vocab.txt", "vocab.json")


@dataclass(frozen=True)
class LoadedModel:
    """A model on its device, and where it came from.

    Attributes:
        name: the model and its weights, as in "SAM (sam-vit-huge)".
        model: the model itself.
        folder: holds the weights and what belongs to them.
        device: where the model is.
    """

    name: str
    model: Any
    folder: Path
    device: torch.device


def load(
    class_name: str, spec: WeightsSpec, weights: str | Path | None, runtime: Runtime, **config: Any
) -> LoadedModel:
    """Load a model for inference, in float32 whatever precision its weights were saved in.

    The runtime's precision is that of the computation, see ``Runtime.encoding``.

    Args:
        class_name: the model's class in transformers.
        spec: whose weights these are.
        weights: folder or name on the hub; None for the model's default.
        runtime: where it is to run.
        config: settings that override the checkpoint's configuration.

    Raises:
        InputError: weights that cannot be had (see ``weights.resolve``), cannot be read, or are
            not whole; a device that is not there.
        MissingExtraError: torch or transformers is not installed.
    """
    feature = f"The model {spec.model}"
    torch = require("torch", "models", feature)
    transformers = require("transformers", "models", feature)
    model_class = _find_class(transformers, class_name, spec)
    device = runtime.torch_device()
    folder = resolve(spec, weights)
    try:
        with _quiet(transformers):
            model, info = model_class.from_pretrained(
                str(folder),
                local_files_only=True,
                output_loading_info=True,
                dtype=torch.float32,
                **config,
            )
    except Exception as error:  # safetensors, torch and transformers raise a dozen kinds
        raise _unreadable(spec, folder, str(error).strip().splitlines()[0]) from error
    _refuse_holes(spec, folder, model, info)
    name = f"{spec.model} ({Path(weights or spec.default).name})"
    return LoadedModel(name, model.eval().to(device), folder, device)


def load_tokenizer(spec: WeightsSpec, folder: Path) -> Any:
    """The tokenizer that lies beside a checkpoint's weights.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    transformers = require("transformers", "models", f"The model {spec.model}")
    # Without these, transformers makes a tokenizer that knows no word, and says nothing.
    if not any((folder / file).is_file() for file in _VOCABULARIES):
        raise _unreadable(spec, folder, f"its tokenizer is missing ({', '.join(_VOCABULARIES)})")
    try:
        return transformers.AutoTokenizer.from_pretrained(str(folder), local_files_only=True)
    except Exception as error:  # as above
        reason = str(error).strip().splitlines()[0]
        raise _unreadable(spec, folder, f"its tokenizer does not load: {reason}") from error


def _find_class(transformers: Any, class_name: str, spec: WeightsSpec) -> Any:
    try:
        return getattr(transformers, class_name)
    except (AttributeError, ImportError) as error:
        raise InputError(
            f"transformers {transformers.__version__} cannot load {spec.model}",
            expected=f"a version with {class_name}",
            fix='pip install --upgrade "easyhecpp[models]"',
        ) from error


@contextmanager
def _quiet(transformers: Any) -> Iterator[None]:
    """No progress bar and no remark on the video models that the published SAM 2 weights are."""
    logging_of = transformers.utils.logging
    verbosity, bar = logging_of.get_verbosity(), logging_of.is_progress_bar_enabled()
    logging_of.set_verbosity_error()
    logging_of.disable_progress_bar()
    try:
        yield
    finally:
        logging_of.set_verbosity(verbosity)
        if bar:
            logging_of.enable_progress_bar()


def _refuse_holes(spec: WeightsSpec, folder: Path, model: Any, info: Any) -> None:
    """Raises InputError for missing tensors: transformers has filled them with random numbers."""
    missing = set(info["missing_keys"]) | {key for key, *_ in info["mismatched_keys"]}
    lost = missing.intersection(_SAME_TENSOR)
    if len(lost) == 1:
        (target,) = lost
        (source,) = set(_SAME_TENSOR) - lost
        tensors = model.state_dict()
        tensors[target].copy_(tensors[source])
        missing -= lost
    if missing:
        raise _unreadable(
            spec,
            folder,
            f"{len(missing)} of its tensors are missing or misshapen, e.g. {min(missing)}",
        )


def _unreadable(spec: WeightsSpec, folder: Path, reason: str) -> InputError:
    return InputError(
        f"the checkpoint of {spec.model} cannot be loaded: {reason}",
        where=folder,
        expected=f"what `{spec.fetch_command()}` puts there",
        fix="fetch the weights again, or name another folder. "
        "Or use --segmenter classical, which needs no weights",
    )
