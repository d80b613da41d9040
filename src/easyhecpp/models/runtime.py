"""Where a model runs and in which precision."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp._optional import require
from easyhecpp.errors import CalibrationError, InputError

if TYPE_CHECKING:
    import torch

PRECISIONS = ("float32", "bfloat16", "float16")
_DEVICE = re.compile(r"auto|cpu|mps|cuda(:\d+)?|xpu(:\d+)?")


@dataclass(frozen=True)
class Runtime:
    """Device and precision of a model.

    Only the image encoder, which takes most of the time, runs in the chosen precision. What handles
    coordinates (prompts, mask decoder, Grounding DINO's transformer and box heads) stays in
    float32: bfloat16 holds a coordinate of a 1024 px input to 4 px only.

    Attributes:
        device: ``auto`` (CUDA when there is one, else the CPU), ``cpu``, ``cuda``, ``cuda:1``,
            ``mps``.
        precision: ``float32``, ``bfloat16`` or ``float16``.
    """

    device: str = "auto"
    precision: str = "float32"

    def __post_init__(self) -> None:
        if not _DEVICE.fullmatch(self.device):
            raise InputError(
                f"unknown device {self.device!r}",
                expected="auto, cpu, cuda, cuda:1 or mps",
                fix="auto takes CUDA where there is one, else the CPU",
            )
        if self.precision not in PRECISIONS:
            raise InputError(
                f"unknown precision {self.precision!r}",
                expected=", ".join(PRECISIONS),
                fix="float32 is right unless the image encoder must be faster on a GPU",
            )

    def torch_device(self) -> torch.device:
        """The device.

        Raises:
            InputError: torch knows no such device, or it is not there.
            MissingExtraError: torch is not installed.
        """
        torch = require("torch", "models", "A pretrained segmenter")
        if self.device == "auto":
            return torch.device("cuda" if torch.cuda.is_available() else "cpu")
        try:
            device = torch.device(self.device)
            torch.empty(1, device=device)
        except (RuntimeError, AssertionError) as error:
            raise InputError(
                f"device {self.device!r} cannot be used ({str(error).splitlines()[0]})",
                expected=", ".join(_devices(torch)),
                fix="leave it at auto, or install the torch build for this device",
            ) from error
        return device

    def encoding(self, device: torch.device) -> AbstractContextManager[Any]:
        """The context in which an image encoder runs: no gradients, the chosen precision."""
        torch = require("torch", "models", "A pretrained segmenter")
        dtype = getattr(torch, self.precision)
        return torch.autocast(device.type, dtype=dtype, enabled=self.precision != "float32")


@contextmanager
def inference(model: str) -> Iterator[None]:
    """No gradients inside; a device that runs out of memory becomes a sentence.

    Raises:
        CalibrationError: the device ran out of memory.
    """
    torch = require("torch", "models", "A pretrained segmenter")
    try:
        with torch.no_grad():
            yield
    except torch.OutOfMemoryError as error:
        raise CalibrationError(
            f"{model} ran out of the GPU's memory. Take a smaller model, close what else uses the "
            "GPU, or run it on the CPU (device cpu)."
        ) from error


def to_float64(tensor: torch.Tensor) -> NDArray[np.float64]:
    """A tensor of any device as a float64 array; by way of the CPU, for MPS has no float64."""
    return tensor.cpu().double().numpy()


def _devices(torch: Any) -> list[str]:
    found = ["auto", "cpu"]
    if torch.cuda.is_available():
        found += [f"cuda:{i}" for i in range(torch.cuda.device_count())]
    if torch.backends.mps.is_available():
        found.append("mps")
    return found
