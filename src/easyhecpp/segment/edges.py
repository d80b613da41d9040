"""The last stage: the rendered contour fitted to the edges in the images themselves.

Masks are biased by more than their noise (a segmenter rounds corners, swallows shadows, cuts half a
pixel inside); an occluding edge in the image is where the arm ends. The pose from the masks is the
start, a few pixels off at most, and this stage may only replace it after a test on contour points
that it did not see.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, perturb_about
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.edge_fit import FEWEST, EdgeFit, counts, offset_scale, stacked
from easyhecpp.segment.edge_reading import EdgeReader, EdgeReading, EdgeSupport
from easyhecpp.segment.scene import Scene
from easyhecpp.solve.joint_offsets import JointOffsets
from easyhecpp.solve.lens import LENS, bent
from easyhecpp.solve.strains import Strain
from easyhecpp.solve.types import PoseEstimate

F64 = NDArray[np.float64]

_CELL_PX = 40.0
"""Side of the squares that edges are held out by; farther apart they err all but independently."""

_UNKNOWNS, _MOST_ALLOWED = 7, 0.1

_SETTLED = 0.007
"""Share of the reach that a step may still move the contour by."""

_LENS_STEPS, _OFFSET_STEPS = 2, 4
"""Edges found through a better lens, or of a better posed arm, tell more of it."""


@dataclass(frozen=True)
class EdgeConfig:
    """Settings of the edge stage.

    Attributes:
        reaches_px: Displacements looked at, from the start to the end.
        steps: Most Gauss-Newton steps for each reach.
        spacing_px: Distance of the contour samples.
    """

    reaches_px: tuple[float, ...] = (8.0, 5.0, 3.0)
    steps: int = 4
    spacing_px: float = 1.0


@dataclass(frozen=True)
class EdgeRefinement:
    """Result of the edge stage.

    Attributes:
        estimate: The refined pose, or the one it started from when that is better.
        accepted: Whether the refined pose is better on contour points that it was not fitted to.
        reason: Why, in words.
        cost_before, cost_after: Robust cost of the unseen points as measured, 0..1; a fit to half
            of the data that is little worse counts as better, see `UnseenCost`.
        support: How well the images bear out the pose in ``estimate``.
        scene: What the estimate goes with, lens and joints refined where the edges ask for that.
        joint_offsets: ``(V, n)`` what its joints have on the recorded ones.
        corrections: What was refined beside the pose, by how much.
    """

    estimate: PoseEstimate
    accepted: bool
    reason: str
    cost_before: float
    cost_after: float
    support: EdgeSupport
    scene: Scene
    joint_offsets: F64
    corrections: tuple[Strain, ...] = ()
    timings_s: dict[str, float] = field(default_factory=dict)

    @property
    def camera(self) -> Camera:
        """Intrinsics that the estimate goes with."""
        return self.scene.camera


def refine_edges(
    backgrounds: Backgrounds,
    start: PoseEstimate,
    *,
    ids: Sequence[str] | None = None,
    weights: Sequence[float] | None = None,
    ignore: Sequence[NDArray[np.bool_] | None] | None = None,
    config: EdgeConfig | None = None,
) -> EdgeRefinement:
    """Fit the rendered contour to the image edges, and keep the fit only when it is better.

    Args:
        backgrounds: The pictures and what is behind the arm.
        start: The pose from the masks, whose contours are off by a few pixels at most.
        ids: Names of the views.
        weights: Trust in each view; a view out of sync has none.
        ignore: Per view ``(H, W)`` bool where the image says nothing (a tool), or None.
        config: Settings.

    Returns:
        The refined estimate, or the start, with the reason and the support in the images.
    """
    config = config or EdgeConfig()
    clock = time.perf_counter()
    scene = backgrounds.scene
    trust = np.ones(len(scene)) if weights is None else np.asarray(weights, np.float64)
    reader = EdgeReader(backgrounds, ignore)
    reader.measure_blur(start.T_mount_cam)
    T = start.T_mount_cam
    for reach in config.reaches_px:
        T = _descend(reader, T, reach, config, trust)
    found = _fitted(reader, T, config, trust)
    recorded = np.zeros(scene.joints.shape)
    if found is None:
        return EdgeRefinement(
            start, False, "Too few edges of the arm were found in the images.",
            1.0, 1.0, reader.support(start.T_mount_cam), scene, recorded,
        )  # fmt: skip
    unseen = _held_out(reader, start.T_mount_cam, found.reader, found.fit, config, trust)
    accepted = unseen.better
    names = tuple(ids) if ids is not None else tuple(str(i) for i in range(len(scene)))
    offset = bool(found.joint_offsets.any())
    estimate = found.fit.estimate(start, names, trust, offset=offset) if accepted else start
    taken = found.reader if accepted else reader
    took = {"edges": time.perf_counter() - clock}
    if accepted:
        estimate = replace(estimate, timings_s={**start.timings_s, **took})
    return EdgeRefinement(
        estimate, accepted, unseen.reason, unseen.before, unseen.after,
        taken.support(estimate.T_mount_cam), taken.scene,
        found.joint_offsets if accepted else recorded, found.corrections if accepted else (), took,
    )  # fmt: skip


@dataclass(frozen=True)
class _Settled:
    """Where the stage ends up.

    Attributes:
        reader: Reads with the lens and the joints that the edges ask for.
        fit: The settled fit, its error bar with the doubt about lens and joints.
        joint_offsets: ``(V, n)`` added to the recorded joints.
        corrections: What was refined beside the pose.
    """

    reader: EdgeReader
    fit: EdgeFit
    joint_offsets: F64
    corrections: tuple[Strain, ...]


def _fitted(
    reader: EdgeReader, T_mount_cam: F64, config: EdgeConfig, trust: F64
) -> _Settled | None:
    """The settled fit, with the lens and the joints free where the edges ask for that.

    A lens that is stated with distortion has been measured, and stays as it is.
    """
    reach, spacing = config.reaches_px[-1], config.spacing_px
    corrected, T = reader, T_mount_cam
    fit = EdgeFit.at(corrected, T, reach, spacing, trust)
    if fit is None:
        return None
    bend = not reader.scene.camera.is_distorted and fit.lens.asked
    offsets = fit.offsets_asked(reader.scene)
    values = np.zeros(len(offsets.names))
    free = len(values) > 0
    for turn in range(_OFFSET_STEPS if free else _LENS_STEPS if bend else 1):
        if fit is None:
            return None
        camera = corrected.scene.camera
        if free:
            freed = fit.freed(lens=bend, offsets=offsets, values=values)
            T, k, values = fit.moved(freed.delta), freed.k, values + freed.offsets
            # Links move by pixels at first.
            reach = config.reaches_px[-2 if turn < _OFFSET_STEPS // 2 else -1]
        else:
            T, k = (fit.with_lens(), fit.lens.k) if bend else (fit.settled(), np.zeros(2))
        if free or bend:
            camera = bent(camera, k) if bend else camera
            corrected = reader.with_scene(reader.scene.corrected(camera, offsets.of(values)))
        fit = EdgeFit.at(corrected, T, reach, spacing, trust)
    fit = None if fit is None else EdgeFit.at(corrected, fit.settled(), reach, spacing, trust)
    return None if fit is None else _told(corrected, fit, offsets, values, bend=bend)


def _told(
    reader: EdgeReader, fit: EdgeFit, offsets: JointOffsets, values: F64, *, bend: bool
) -> _Settled:
    """A settled fit with what was refined beside the pose, and with the doubt about it.

    Args:
        reader: With what was refined.
        fit: Settled.
        offsets: What the joints may be off by.
        values: ``(m,)`` what the offsets are.
        bend: Whether the lens was refined.
    """
    names, found, sigmas = list(offsets.names), values, np.zeros(0)
    if names:
        doubt = fit.freed(lens=bend, offsets=offsets, values=values)
        sigmas, sigma_k = doubt.sigma_offsets, doubt.sigma_k
        fit = fit.with_doubt(doubt.pose_covariance)
    else:
        sigma_k = np.sqrt(np.diag(fit.lens.covariance))
        fit = fit.with_lens_doubt() if bend else fit
    if bend:
        names += LENS
        found = np.r_[values, reader.scene.camera.distortion[:2]]
        sigmas = np.r_[sigmas, sigma_k]
    refined = zip(names, found.tolist(), sigmas.tolist(), strict=True)
    return _Settled(reader, fit, offsets.of(values), tuple(Strain(*one) for one in refined))


@dataclass(frozen=True)
class UnseenCost:
    """Robust cost of contour points that a fit has not seen, 0..1.

    Attributes:
        before: At the start.
        after: At fits to half of the data.
        allowance: Share of ``after`` that a fit to all of the data loses by seeing twice as much.
    """

    before: float
    after: float
    allowance: float = 0.0

    @property
    def better(self) -> bool:
        """Whether the fit to all of the data is better than the start."""
        return self.after * (1.0 - self.allowance) < self.before

    @property
    def reason(self) -> str:
        """Why it is or is not, a sentence with the costs as they were measured."""
        costs = f"cost {self.after:.4f}, before {self.before:.4f}"
        points = "Contour points that the fit did not see lie"
        if not self.better:
            return f"{points} no closer to the edges than before: {costs}."
        if self.after < self.before:
            return f"{points} closer to the edges than before: {costs}."
        return (
            f"{points} about as close to the edges as before: {costs}. That fit saw half of the "
            f"data; the fit to all of it is allowed {self.allowance:.1%} less, which decided for "
            "it."
        )


def _descend(
    reader: EdgeReader, T_mount_cam: F64, reach: float, config: EdgeConfig, trust: F64
) -> F64:
    """Robust Gauss-Newton with a scale that shrinks with the reach."""
    scene = reader.scene
    T = inverse(T_mount_cam)
    for _ in range(config.steps):
        readings = reader.read(inverse(T), reach, spacing_px=2.0 * config.spacing_px)
        J, r, w = stacked(readings, trust, offset_scale(readings, reach))
        if np.count_nonzero(w) < FEWEST:
            break
        A = np.column_stack([J, np.ones(len(J))])
        H = A.T @ (w[:, None] * A)
        H[:6, :6] += 1e-6 * np.diag(np.diag(H[:6, :6]))
        H[6, 6] += w.sum() * 0.1
        step = np.linalg.solve(H, A.T @ (w * r))[:6]
        T = perturb_about(T, scene.centre_cam(T), step)
        if float(np.sqrt(np.mean(np.square(J @ step)))) < _SETTLED * reach:
            break
    return inverse(T)


def _held_out(
    reader: EdgeReader,
    T_start: F64,
    corrected: EdgeReader,
    fit: EdgeFit,
    config: EdgeConfig,
    trust: F64,
) -> UnseenCost:
    """Robust cost of contour points that a fit has not seen, at the start and at the fit.

    ``corrected`` reads through the lens of the fit, ``reader`` through that of the start.

    The contour is cut into squares of 40 px, painted like a chessboard. The pose is fitted to one
    colour and judged on the other, and the other way round. At either pose the edges are looked
    for anew, with the same reach and the same scale, so that neither has the home advantage.

    A fit to one colour has half of the squares to learn its seven unknowns from. What is handed out
    is fitted to all of them: of n squares that err independently it loses ``7 / n`` of the noise
    less on points that it has not seen, and the cost is allowed to be as much lower.
    """
    reach = config.reaches_px[0]
    at_start = reader.read(T_start, reach, spacing_px=2.0)
    at_fit = corrected.read(fit.T_mount_cam, reach, spacing_px=2.0)
    scale = offset_scale(at_fit, config.reaches_px[-1])
    J, r, w = stacked(at_fit, trust, scale)
    colour = np.concatenate([_chessboard(e.contour.points) for e in at_fit])
    say = np.concatenate(counts(at_fit, trust))
    after, total = 0.0, 0.0
    for side in (0, 1):
        seen = (colour == side) & (w > 0)
        if np.count_nonzero(seen) < FEWEST // 2:
            return UnseenCost(1.0, 1.0)
        A = np.column_stack([J[seen], np.ones(np.count_nonzero(seen))])
        H = A.T @ (w[seen, None] * A)
        H[np.diag_indices(6)] *= 1.0 + 1e-6
        H[6, 6] += 0.1 * w[seen].sum()
        step = np.linalg.solve(H, A.T @ (w[seen] * r[seen]))
        unseen = colour != side
        left = r[unseen] - J[unseen] @ step[:6]
        after += float(say[unseen] @ _cost(left, scale))
        total += float(say[unseen].sum())
    say = np.concatenate(counts(at_start, trust))
    before = float(say @ _cost(np.concatenate([e.offset for e in at_start]), scale))
    return UnseenCost(
        before / max(float(say.sum()), 1e-9),
        after / max(total, 1e-9),
        min(_UNKNOWNS / max(_squares(at_fit, w > 0), 1), _MOST_ALLOWED),
    )


def _squares(readings: Sequence[EdgeReading], used: NDArray[np.bool_]) -> int:
    """Number of squares that hold a used sample, over all views."""
    start, squares = 0, 0
    for reading in readings:
        points = reading.contour.points
        own = points[used[start : start + len(points)]]
        squares += len(np.unique(np.floor(own / _CELL_PX).astype(np.int64), axis=0))
        start += len(points)
    return squares


def _chessboard(points: F64) -> NDArray[np.int64]:
    cell = np.floor(points / _CELL_PX).astype(np.int64)
    return (cell[:, 0] + cell[:, 1]) % 2


def _cost(offset: F64, scale: float) -> F64:
    """Tukey's cost, 0..1."""
    u = np.clip(np.abs(offset) / (4.685 * scale), 0.0, 1.0)
    return 1.0 - np.power(1.0 - np.square(u), 3)
