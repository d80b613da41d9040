"""Loading a transformers model from a folder, and refusing one that is not whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from easyhecpp._optional import require
from easyhecpp.errors import InputError
from easyhecpp.models.checkpoint import CLASSICAL, WeightsSpec
from easyhecpp.models.runtime import Runtime
from easyhecpp.models.weights import first_line, resolve

if TYPE_CHECKING:
    import torch

# One matrix under two names in all of the SAM family. transformers 4 saved it under one of them,
# and transformers 5 does not tie the two for SAM 2 and SAM 3. Nothing else may be missing.
_SAME_TENSOR = (
    "prompt_encoder.shared_embedding.positional_embedding",
    "shared_image_embedding.positional_embedding",
)


@dataclass(frozen=True)
class LoadedModel:
    """A model on its device, and where it came from.

    Attributes:
        name: the model and its weights, as in "SAM (sam-vit-huge)".
        model: the model itself.
        folder: holds the weights and what belongs to them.
        device: where the model is.
        tokenizer: cuts text into what the model reads; None for a model that reads none.
    """

    name: str
    model: Any
    folder: Path
    device: torch.device
    tokenizer: Any = None


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
        raise _unreadable(spec, weights, folder, first_line(error)) from error
    holes = _holes(model, info)
    if holes is not None:
        raise _unreadable(spec, weights, folder, holes)
    tokenizer = None
    if spec.tokenizer:
        try:
            tokenizer = transformers.AutoTokenizer.from_pretrained(
                str(folder), local_files_only=True
            )
        except Exception as error:  # as above
            reason = f"its tokenizer does not load: {first_line(error)}"
            raise _unreadable(spec, weights, folder, reason) from error
    name = f"{spec.model} ({Path(spec.default if weights is None else weights).name})"
    return LoadedModel(name, model.eval().to(device), folder, device, tokenizer)


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


def _holes(model: Any, info: Any) -> str | None:
    """Which tensors a checkpoint lacks, for transformers fills them with random numbers."""
    missing = set(info["missing_keys"]) | {key for key, *_ in info["mismatched_keys"]}
    lost = missing.intersection(_SAME_TENSOR)
    if len(lost) == 1:
        (target,) = lost
        (source,) = set(_SAME_TENSOR) - lost
        tensors = model.state_dict()
        tensors[target].copy_(tensors[source])
        missing -= lost
    if not missing:
        return None
    return f"{len(missing)} of its tensors are missing or misshapen, e.g. {min(missing)}"


def _unreadable(
    spec: WeightsSpec, weights: str | Path | None, folder: Path, reason: str
) -> InputError:
    return InputError(
        f"the checkpoint of {spec.model} cannot be loaded: {reason}",
        where=folder,
        expected=f"what `{spec.fetch_command(weights)}` puts there",
        fix=f"fetch the weights again, or name another folder. {CLASSICAL}",
    )
