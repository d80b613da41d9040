"""Where a camera could stand: seeds all round the arm, each laid over the change maps by FFT.

A seed looks at the middle of the arm; laying what it sees over the pictures at all shifts turns it
to wherever the arm is in view. Laying it over the pictures turned about their centre does the same
for a camera that is turned about its axis, at a fraction of the cost of another seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from easyhecpp._parallel import parallel_map, usable_cores
from easyhecpp.camera import Camera
from easyhecpp.geometry import exp_so3, inverse, make_transform
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.render._jit import jit
from easyhecpp.segment.classical.change import ChangeMaps
from easyhecpp.segment.scene import Scene

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
C64 = NDArray[np.complex64]

SEARCH_MESH_ERROR = 0.012
"""Metres that the simplified meshes of the search may be off: a fraction of its pixels."""

SEARCH_VIEWS = 8
"""Most views that the search looks at; the best of it is scored on all."""

_TURNS_KEPT = 3
"""Of the turns of a seed."""

SEARCH_TOLERANCE = 0.1
"""What a pixel without change counts against a seed: seeds are off by degrees, arms are thin."""


@dataclass(frozen=True)
class Scored:
    """A camera pose with its score.

    Attributes:
        T_mount_cam: ``(4, 4)``.
        score: Share of the change that the arm's motion explains, at most 1.
    """

    T_mount_cam: F64
    score: float


def search(
    scene: Scene,
    changes: ChangeMaps,
    seeds: F64,
    turns: F64,
    *,
    size_px: int,
    max_pairs: int,
    keep: int,
) -> list[Scored]:
    """Lay every seed's rendered change over the observed one, all shifts at once.

    Args:
        scene: The arm.
        changes: Change between pairs of views.
        seeds: ``(S, 4, 4)`` T_mount_cam.
        turns: ``(R,)`` angles about the camera's axis that each is tried at, radians.
        size_px: Longer side of the images that are compared.
        max_pairs: Pairs of views to look at.
        keep: How many of the best to return.

    Returns:
        The best, each looking to where it fits best; best first.
    """
    lay = _Overlay(scene, changes, turns, size_px, max_pairs)
    parts = np.array_split(seeds, 4 * usable_cores())
    found = parallel_map(lambda part: [s for T in part for s in lay(T)], parts)
    ranked = sorted((s for part in found for s in part), key=lambda s: -s.score)
    return ranked[:keep]


class _Overlay:
    """Compares one seed with the change maps; holds what all seeds share.

    Args:
        scene: The arm.
        changes: Change between pairs of views.
        turns, size_px, max_pairs: See `search`.
    """

    def __init__(
        self, scene: Scene, changes: ChangeMaps, turns: F64, size_px: int, max_pairs: int
    ) -> None:
        height, width = changes.maps.shape[1:]
        shrink = max(1, round(max(width, height) / size_px))
        size = (max(1, round(width / shrink)), max(1, round(height / shrink)))
        small = np.stack(
            [cv2.resize(m, size, interpolation=cv2.INTER_AREA) for m in changes.maps]
        ).astype(np.float32)
        chosen = informative_pairs(small, changes.pairs, max_pairs)
        self.views, numbers = np.unique(changes.pairs[chosen], return_inverse=True)
        self.pairs = np.ascontiguousarray(numbers.reshape(-1, 2).astype(np.int32))
        maps = _weighed(np.maximum(small[chosen], np.float32(-SEARCH_TOLERANCE)))
        self.scale = 1.0 / max(float(np.maximum(maps, 0.0).sum()), 1.0)
        self.camera = scene.camera.scaled(size[0] / scene.camera.width)
        self.turns = turns
        # Turned pictures stand upright in it too.
        room = size if len(turns) == 1 else (max(size), max(size))
        canvas_w, canvas_h = _fast_length(2 * room[0]), _fast_length(2 * room[1])
        left, top = (canvas_w - size[0]) // 2, (canvas_h - size[1]) // 2
        padded = np.zeros((len(maps), canvas_h, canvas_w), np.float32)
        padded[:, top : top + size[1], left : left + size[0]] = maps
        middle = (self.camera.cx + left, self.camera.cy + top)
        self.spectra = np.stack([np.conj(_rfft2(_turned(padded, middle, t))) for t in turns])
        self.shape = (canvas_h, canvas_w)
        self.reach = (room[1] // 2, room[0] // 2)
        self.scene = scene
        self.renderer = SilhouetteRenderer(
            scene.rig.robot.simplified(SEARCH_MESH_ERROR).meshes,
            _moved(self.camera, canvas_w, canvas_h, left, top),
        )

    def __call__(self, T_mount_cam: F64) -> list[Scored]:
        """The seed at the turns that fit best, looking to where it does."""
        T_cam_mount = inverse(T_mount_cam)
        covers = np.zeros((len(self.views), *self.shape), np.float32)
        for cover, view in zip(covers, self.views, strict=True):
            self.renderer.coverage(T_cam_mount @ self.scene.Ts_mount_link[view], cover)
        differs = np.empty((len(self.pairs), *self.shape), np.float32)
        _differences(covers, self.pairs, differs)
        spectra = _rfft2(differs)
        product = np.empty((len(self.turns), *spectra.shape[1:]), np.complex64)
        _correlated(spectra, self.spectra, product)
        scores: F32 = np.asarray(fft.irfft2(product, s=self.shape))  # type: ignore[arg-type]
        # Correlation: the value at shift s is the score of the rendering moved by -s.
        ry, rx = self.reach
        near = np.roll(scores, (ry, rx), axis=(1, 2))[:, : 2 * ry + 1, : 2 * rx + 1]
        near = near.reshape(len(near), -1)
        best = near.argmax(axis=1)
        highest = near.max(axis=1)
        found = []
        for r in np.argsort(-highest)[:_TURNS_KEPT]:
            dy, dx = divmod(int(best[r]), 2 * rx + 1)
            upright = inverse(self._looking(T_cam_mount, np.array([rx - dx, ry - dy], float)))
            turned = upright @ make_transform(
                exp_so3([0.0, 0.0, float(self.turns[r])]), np.zeros(3)
            )
            found.append(Scored(turned, float(highest[r]) * self.scale))
        return found

    def _looking(self, T_cam_mount: F64, shift_px: F64) -> F64:
        """The arm's image moved by ``shift_px``, by turning the camera."""
        centre = self.scene.centre_cam(T_cam_mount)
        before = centre / np.linalg.norm(centre)
        pixel = self.camera.project(centre) + shift_px
        after = self.camera.unproject(pixel)
        after = after / np.linalg.norm(after)
        axis = np.cross(before, after)
        sine = float(np.linalg.norm(axis))
        if sine < 1e-9:
            return T_cam_mount
        R = exp_so3(axis / sine * np.arctan2(sine, float(before @ after)))
        return make_transform(R, np.zeros(3)) @ T_cam_mount


def _turned(maps: F32, middle: tuple[float, float], turn: float) -> F32:
    """Maps ``(P, H, W)`` as a camera sees them that is turned back by ``turn`` radians."""
    if turn == 0.0:
        return maps
    # OpenCV turns counter-clockwise as seen, y being down; a camera's turn is clockwise.
    M = cv2.getRotationMatrix2D(middle, -np.rad2deg(turn), 1.0)
    size = (maps.shape[2], maps.shape[1])
    turned = [cv2.warpAffine(m, M, size, flags=cv2.INTER_LINEAR) for m in maps]
    return np.stack(turned).astype(np.float32)


def _fast_length(least: int) -> int:
    return int(fft.next_fast_len(least, real=True))  # type: ignore[arg-type]


def _rfft2(images: F32) -> C64:
    """Spectra of ``(P, H, W)`` images, in single precision."""
    return np.asarray(fft.rfft2(images))  # type: ignore[return-value]


def _moved(camera: Camera, width: int, height: int, left: int, top: int) -> Camera:
    return Camera(
        width, height, camera.fx, camera.fy, camera.cx + left, camera.cy + top,
        camera.distortion_model, camera.distortion, camera.frame,
    )  # fmt: skip


def informative_pairs(maps: F32, pairs: I32, count: int) -> NDArray[np.intp]:
    """Pairs with much change, among few views, every one of these about equally often."""
    gain = np.maximum(maps, 0.0).sum(axis=(1, 2)).astype(np.float64)
    views = _changing_views(maps, pairs, SEARCH_VIEWS)
    gain[~np.isin(pairs, views).all(axis=1)] = -1.0
    used = np.zeros(int(pairs.max()) + 1)
    chosen: list[int] = []
    while len(chosen) < min(count, int(np.count_nonzero(gain >= 0.0))):
        value = np.where(gain >= 0.0, gain / (1.0 + used[pairs].sum(axis=1)), -1.0)
        value[chosen] = -1.0
        best = int(np.argmax(value))
        chosen.append(best)
        used[pairs[best]] += 1.0
    return np.array(chosen, np.intp)


def _changing_views(maps: F32, pairs: I32, most: int | None) -> NDArray[np.intp]:
    """The views with most change against the others, in their order."""
    gain = np.maximum(maps, 0.0).sum(axis=(1, 2)).astype(np.float64)
    per_view = np.bincount(pairs.ravel(), np.repeat(gain, 2))
    return np.sort(np.argsort(-per_view, kind="stable")[:most])


def _weighed(maps: F32) -> F32:
    """Every pair with the same say, so that none wins by something else that changed much in it."""
    mass = np.maximum(maps, 0.0).sum(axis=(1, 2), keepdims=True) / maps[0].size
    return (maps / np.maximum(mass, 0.01)).astype(np.float32)


@jit
def _differences(covers: F32, pairs: I32, out: F32) -> None:
    """Coverage of one view but not of the other, for every pair: ``(P, H, W)``."""
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        for y in range(covers.shape[1]):
            for x in range(covers.shape[2]):
                a, b = covers[i, y, x], covers[j, y, x]
                out[p, y, x] = a + b - np.float32(2.0) * a * b


@jit
def _correlated(spectra: C64, observed: C64, out: C64) -> None:
    """Products of ``(P, H, W)`` with each of ``(R, P, H, W)``, summed over P: ``(R, H, W)``."""
    for r in range(observed.shape[0]):
        for y in range(spectra.shape[1]):
            out[r, y] = 0.0
            for p in range(spectra.shape[0]):
                for x in range(spectra.shape[2]):
                    out[r, y, x] += spectra[p, y, x] * observed[r, p, y, x]


@jit
def _explained(covers: F32, maps: F32, pairs: I32) -> tuple[float, float]:
    """Sum over pairs and pixels of evidence times rendered change, and of positive evidence."""
    total = 0.0
    available = 0.0
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        for y in range(covers.shape[1]):
            row = np.float32(0.0)
            most = np.float32(0.0)
            for x in range(covers.shape[2]):
                a, b = covers[i, y, x], covers[j, y, x]
                g = maps[p, y, x]
                row += (a + b - np.float32(2.0) * a * b) * g
                most += max(g, np.float32(0.0))
            total += row
            available += most
    return total, available


class PairScore:
    """Scores poses by all pairs of views.

    Args:
        scene: The arm.
        changes: Change between pairs of views; its size is the size of the comparison.
        tolerance: How much a pixel without change counts against a pose that moves the arm there,
            relative to one with change: low forgives a pose that is not yet exact.
        most_views: Only so many views are looked at, those with most change; None for all.
    """

    def __init__(
        self,
        scene: Scene,
        changes: ChangeMaps,
        tolerance: float,
        most_views: int | None = None,
    ) -> None:
        self.scene = scene
        self.reduction = changes.reduction
        self.views = _changing_views(changes.maps, changes.pairs, most_views)
        within = np.isin(changes.pairs, self.views).all(axis=1)
        self.pairs = np.searchsorted(self.views, changes.pairs[within]).astype(np.int32)
        self.maps = _weighed(np.maximum(changes.maps[within], np.float32(-tolerance)))

    def __call__(self, T_mount_cam: F64) -> float:
        """Share of the change that the arm's motion explains, at most 1."""
        covers = self.scene.coverages(
            inverse(T_mount_cam), self.reduction, coarse=True, views=self.views
        )
        total, available = _explained(covers, self.maps, self.pairs)
        return total / max(available, 1.0)


def distinct(found: Sequence[Scored], count: int, *, metres: float, radians: float) -> list[Scored]:
    """The best of each group of poses that lie together; best first."""
    kept: list[Scored] = []
    for candidate in sorted(found, key=lambda s: -s.score):
        R, t = candidate.T_mount_cam[:3, :3], candidate.T_mount_cam[:3, 3]
        for other in kept:
            angle = np.arccos(np.clip((np.trace(R.T @ other.T_mount_cam[:3, :3]) - 1) / 2, -1, 1))
            near = np.linalg.norm(t - other.T_mount_cam[:3, 3]) < metres
            if angle < radians and near:
                break
        else:
            kept.append(candidate)
            if len(kept) == count:
                break
    return kept
