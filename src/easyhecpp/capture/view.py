"""One view: where the joints were, and what the camera saw."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from easyhecpp.capture.image_data import CACHE, read_depth, read_image, read_mask
from easyhecpp.errors import InputError


class View:
    """One view of the arm, immutable.

    Picture, mask and depth are given as arrays, or as paths that are read when they are asked for.
    What was read from a file stays in memory only as long as there is room, and is read-only.

    Args:
        id: Name of the view, e.g. ``0007``.
        joints: Joint positions (n,), in the robot's order; radians and metres.
        image: ``(H, W, 3)`` uint8 RGB, or a file.
        mask: ``(H, W)`` bool, true on the arm, or a file.
        depth: ``(H, W)`` float32 metres, 0 where unknown, or a file.
        image_bits: How many bits an image file with 16 bits per channel uses.

    Raises:
        InputError: The joints are no vector of finite numbers, or an array has the wrong shape.
    """

    __slots__ = ("_depth", "_image", "_image_bits", "_mask", "id", "joints")

    id: str
    joints: NDArray[np.float64]
    _image: NDArray[np.uint8] | Path | None
    _image_bits: int
    _mask: NDArray[np.bool_] | Path | None
    _depth: NDArray[np.float32] | Path | None

    def __init__(
        self,
        id: str,  # noqa: A002
        joints: ArrayLike,
        image: ArrayLike | Path | None = None,
        mask: ArrayLike | Path | None = None,
        depth: ArrayLike | Path | None = None,
        image_bits: int = 16,
    ) -> None:
        positions = np.array(joints, dtype=np.float64)
        if positions.ndim != 1 or not np.isfinite(positions).all():
            raise InputError(
                f"The joints of view '{id}' are {positions.tolist()}",
                expected="a vector of finite numbers, one per joint of the robot",
            )
        positions.setflags(write=False)
        object.__setattr__(self, "id", str(id))
        object.__setattr__(self, "joints", positions)
        object.__setattr__(self, "_image", _source(image, id, "image", np.uint8, 3))
        object.__setattr__(self, "_image_bits", image_bits)
        object.__setattr__(self, "_mask", _source(mask, id, "mask", np.bool_, 2))
        object.__setattr__(self, "_depth", _source(depth, id, "depth", np.float32, 2))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a View cannot be changed (tried to set '{name}')")

    def __reduce__(self) -> tuple[Any, ...]:
        return View, (self.id, self.joints, *self._pictures())

    def __repr__(self) -> str:
        parts = [
            name
            for name, there in (
                ("image", self.has_image),
                ("mask", self.has_mask),
                ("depth", self.has_depth),
            )
            if there
        ]
        return f"View('{self.id}', {len(self.joints)} joints, {' + '.join(parts) or 'no pictures'})"

    def with_joints(self, joints: ArrayLike) -> View:
        """The same pictures, said to belong to other joint positions (n,), radians and metres."""
        return View(self.id, joints, *self._pictures())

    def _pictures(self) -> tuple[Any, ...]:
        return self._image, self._mask, self._depth, self._image_bits

    @property
    def image(self) -> NDArray[np.uint8] | None:
        """The picture ``(H, W, 3)`` uint8 RGB, if there is one."""
        return _load(self._image, read_image, self._image_bits)

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """Where the arm is, ``(H, W)`` bool, if that is known."""
        return _load(self._mask, read_mask)

    @property
    def depth(self) -> NDArray[np.float32] | None:
        """Depth ``(H, W)`` float32 metres, 0 where unknown, if there is any."""
        return _load(self._depth, read_depth)

    @property
    def has_image(self) -> bool:
        """Whether there is a picture; reads nothing."""
        return self._image is not None

    @property
    def has_mask(self) -> bool:
        """Whether there is a mask; reads nothing."""
        return self._mask is not None

    @property
    def has_depth(self) -> bool:
        """Whether there is depth; reads nothing."""
        return self._depth is not None

    def check_size(self, height: int, width: int) -> None:
        """Check that what is in memory has the camera's size; files are not opened.

        Raises:
            InputError: A picture, mask or depth image has another size.
        """
        for what, source in (("image", self._image), ("mask", self._mask), ("depth", self._depth)):
            if isinstance(source, np.ndarray) and source.shape[:2] != (height, width):
                raise InputError(
                    f"The {what} of view '{self.id}' is {source.shape[1]}x{source.shape[0]} "
                    f"pixels, the camera {width}x{height}",
                    expected=f"a {what} of the camera's size",
                )

    @property
    def image_path(self) -> Path | None:
        """The picture's file, when it comes from one."""
        return self._image if isinstance(self._image, Path) else None


def _source(
    given: ArrayLike | Path | None, view: str, what: str, dtype: type[np.generic], ndim: int
) -> NDArray[Any] | Path | None:
    if given is None or isinstance(given, Path):
        return given
    if isinstance(given, str):
        return Path(given)
    array = np.asarray(given)
    if array.ndim != ndim or (ndim == 3 and array.shape[2] != 3) or 0 in array.shape:
        raise InputError(
            f"The {what} of view '{view}' has the shape {array.shape}",
            expected="(height, width, 3)" if ndim == 3 else "(height, width)",
        )
    if dtype is np.uint8 and array.dtype != np.uint8:
        raise InputError(
            f"The {what} of view '{view}' is an array of {array.dtype}", expected="uint8, 0 to 255"
        )
    return array.astype(dtype, copy=False)


def _load(source: Any, reader: Callable[..., NDArray[Any]], *settings: object) -> Any:
    return CACHE.get(source, reader, *settings) if isinstance(source, Path) else source
