"""The pictures, masks and depth images of a capture folder, matched to views and checked."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from easyhecpp._parallel import parallel_map
from easyhecpp._paths import reason
from easyhecpp.camera import Camera
from easyhecpp.capture._text import listing, plural
from easyhecpp.capture.image_data import bits_used, conversion_of, inspect_mask, read_depth
from easyhecpp.capture.image_files import IMAGE_SUFFIXES, ImageHeader, read_header
from easyhecpp.capture.problems import Findings, Part
from easyhecpp.errors import InputError

T = TypeVar("T")

# Formats that people try and that are not read: named, so that nobody wonders where views went.
_OTHER_IMAGE_SUFFIXES = (".bmp", ".tif", ".tiff", ".webp", ".exr", ".npy", ".heic", ".ppm", ".pgm")

#: What goes wrong with a view when its file of this kind cannot be used.
_PARTS: dict[str, Part] = {"image": "view", "mask": "mask", "depth image": "depth"}


def list_pictures(folder: Path, kind: str, findings: Findings) -> dict[str, Path]:
    """The PNG and JPEG files of a folder by view id, sorted; empty when there is no folder."""
    try:
        files = sorted(item for item in folder.iterdir() if not item.name.startswith("."))
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise InputError(
            f"The folder of {kind}s cannot be listed: {reason(error)}",
            where=folder,
            fix="Make it a folder that you may read",
        ) from error
    pictures: dict[str, Path] = {}
    for file in files:
        if file.suffix.lower() not in IMAGE_SUFFIXES:
            continue
        if file.stem in pictures:
            findings.error(
                f"View '{file.stem}' has two {kind}s: {pictures[file.stem].name} and {file.name}",
                where=str(folder),
                expected=f"one {kind} per view",
                fix="Delete one of them",
                views=(file.stem,),
                drops=_PARTS[kind],
            )
        pictures.setdefault(file.stem, file)
    others = [file.name for file in files if file.suffix.lower() in _OTHER_IMAGE_SUFFIXES]
    if others:
        findings.warn(
            f"{plural(len(others), 'file')} of another format not used: {listing(others, 5)}",
            where=str(folder),
            fix="Convert them to PNG",
        )
    return pictures


def check_images(images: Mapping[str, Path], camera: Camera | None, findings: Findings) -> int:
    """Check that all pictures are whole and of the camera's size.

    Returns:
        How many bits the pictures with 16 bits per channel use; the same for all, so that none
        becomes brighter than the others.
    """
    headers = _headers(images, "image", findings)
    _check_sizes(headers, "image", camera, findings)
    used = []
    for view, header in headers.items():
        if header.bits > 8:
            with findings.catching(views=(view,), drops="view"):
                used.append(bits_used(images[view]))
    bits = max(used, default=16)
    converted = defaultdict(list)
    for view, header in headers.items():
        if (conversion := conversion_of(header, bits)) is not None:
            converted[conversion].append(view)
    for conversion, views in converted.items():
        findings.note(f"In the image of {_views(views)}, {conversion}")
    return bits


def check_masks(masks: Mapping[str, Path], camera: Camera | None, findings: Findings) -> None:
    """Check that all masks are whole, of the camera's size, and show some arm and some rest."""
    headers = _headers(masks, "mask", findings)
    _check_sizes(headers, "mask", camera, findings)
    several = []
    looks = _tried(inspect_mask, [masks[view] for view in headers])
    for view, look in zip(headers, looks, strict=True):
        with findings.catching(views=(view,), drops="mask"):
            share, n_values = look()
            if share in (0.0, 1.0):
                findings.error(
                    f"The mask of view '{view}' is {'empty' if share == 0.0 else 'all arm'}",
                    where=str(masks[view]),
                    expected="white where the arm is, black elsewhere",
                    fix="Delete the file to let the arm be segmented anew, or draw it again",
                    views=(view,),
                    drops="mask",
                )
            elif n_values > 2:
                several.append(view)
    if several:
        findings.note(
            f"The mask of {_views(several)} has more than two values: what is above half the "
            "maximum counts as arm"
        )


def check_depths(depths: Mapping[str, Path], camera: Camera | None, findings: Findings) -> None:
    """Check that all depth images are whole, 16 bit and aligned with the camera."""
    headers = _headers(depths, "depth image", findings)
    _check_sizes(headers, "depth image", camera, findings)
    looks = _tried(lambda path: read_depth(path).shape, [depths[view] for view in headers])
    for view, look in zip(headers, looks, strict=True):
        with findings.catching(views=(view,), drops="depth"):
            look()


def _tried(read: Callable[[Path], T], files: Sequence[Path]) -> list[Callable[[], T]]:
    """Read files on all cores; per file a function that returns the outcome, or raises its error.

    So findings are recorded in the order of the files, whatever thread was first.
    """

    def attempt(path: Path) -> Callable[[], T]:
        try:
            found = read(path)
        except InputError as error:
            problem = error

            def fail() -> T:
                raise problem

            return fail
        return lambda: found

    return parallel_map(attempt, files)


def _headers(files: Mapping[str, Path], kind: str, findings: Findings) -> dict[str, ImageHeader]:
    """Headers of the files that are whole."""
    headers = {}
    for view, path in files.items():
        with findings.catching(views=(view,), drops=_PARTS[kind]):
            headers[view] = read_header(path)
    return headers


def _check_sizes(
    headers: Mapping[str, ImageHeader], kind: str, camera: Camera | None, findings: Findings
) -> None:
    if camera is None:
        return
    wrong = defaultdict(list)
    for view, header in headers.items():
        if (header.width, header.height) != (camera.width, camera.height):
            wrong[header.width, header.height].append(view)
    for (width, height), views in wrong.items():
        findings.error(
            f"The {kind} of {_views(views)} is {width}x{height} pixels, the camera "
            f"{camera.width}x{camera.height}",
            expected=f"{kind}s of the size in camera_info",
            fix=_size_fix(kind, width, height, camera),
            views=tuple(views),
            drops=_PARTS[kind],
        )


def _size_fix(kind: str, width: int, height: int, camera: Camera) -> str:
    if kind != "image":
        return f"Store the {kind} at the size of the image, pixel for pixel"
    if (height, width) == (camera.width, camera.height):
        return "The images are turned by 90 degrees: store them as the camera gives them"
    if width * camera.height == height * camera.width:
        return (
            f"The images are scaled by {width / camera.width:.4g}: store them at full size, or "
            "record camera_info at the images' resolution"
        )
    return "Record images and camera_info from the same stream at the same resolution"


def _views(views: list[str]) -> str:
    return f"view{'s' if len(views) > 1 else ''} {listing(views)}"
