"""The options of pretrained segmenters, which several commands share."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from easyhecpp.session import PretrainedConfig


@dataclass(frozen=True)
class PretrainedOptions:
    """Only for pretrained segmenters."""

    text_weights: str | None = None
    """Folder or hub name in place of the text model's own weights."""

    box_weights: str | None = None
    """The same for the box model."""

    device: str = "auto"
    """Where the models run: auto (CUDA if there is one, else the CPU), cpu, cuda, cuda:1, mps."""

    precision: Literal["float32", "bfloat16", "float16"] = "float32"
    """Of the image encoders; what handles coordinates stays in float32."""

    prompts: Literal["a", "b", "c", "d", "e", "f"] = "e"
    """How the projected links are put to the box model: a row of the paper's table on prompts."""

    text: str = "robot arm"
    """What the text model looks for."""

    def config(self) -> PretrainedConfig:
        """The same for the library."""
        from easyhecpp.session import PretrainedConfig

        return PretrainedConfig(**asdict(self))
