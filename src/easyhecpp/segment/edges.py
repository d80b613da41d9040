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
from scipy.linalg import cho_factor, cho_solve

from easyhecpp._parallel import parallel_map
from easyhecpp.geometry import inverse, log_se3, perturb_about, pose_covariance_from_centred
from easyhecpp.render import Contour
from easyhecpp.segment._edge_kernel import AGAINST_PLATE, NONE, STEP, find_edges
from easyhecpp.segment.backgrounds import Backgrounds
from easyhecpp.segment.classical.scene import Scene
from easyhecpp.solve.correlation import ContourPoints, NoiseModel, average_samples, fit_noise
from easyhecpp.solve.evidence import Evidence
from easyhecpp.solve.types import ContourFit, PoseEstimate, ViewFit

F64 = NDArray[np.float64]

COVARIANCE_INFLATION = 1.5
"""On the covariance of the edge fit, for what its noise model leaves out."""

_DILATION_PRIOR_PX = 0.15
"""Edges common to all contours: sharpening halos and the lens' blur, not a segmenter's habits."""

_BLUR_PX = 1.0
_SMALLEST_SCALE_PX = 0.35
_CELL_PX = 40.0
_FEWEST = 60


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
class EdgeReading:
    """What the images say along the contour of one view at one pose; full-size pixels.

    Attributes:
        contour: The samples.
        offset: ``(N,)`` outward displacement of the edge from the sample.
        kind: ``(N,)`` what the edge was found from, 0 for no edge found.
        contrast: ``(N,)`` steepness of the edge, 0..255 per pixel.
    """

    contour: Contour
    offset: F64
    kind: NDArray[np.int8]
    contrast: F64

    @property
    def found(self) -> NDArray[np.bool_]:
        """``(N,)`` whether there is an edge."""
        return self.kind != NONE


@dataclass(frozen=True)
class EdgeSupport:
    """How well the images bear a pose out; the check against wrong poses.

    Attributes:
        share: Share of the contour with an image edge within 1.5 px.
        length_px: Length of the visible contour, all views.
        covered: Share of the image that the arm covers, mean over the views.
        views: Share for each view, nan where no contour is visible.
    """

    share: float
    length_px: float
    covered: float
    views: F64


@dataclass(frozen=True)
class EdgeRefinement:
    """Result of the edge stage.

    Attributes:
        estimate: The refined pose, or the one it started from when that is better.
        accepted: Whether the refined pose is better on contour points that it was not fitted to.
        reason: Why, in a sentence.
        cost_before, cost_after: Robust cost of the unseen points, 0..1, smaller is better.
        support: How well the images bear out the pose in ``estimate``.
    """

    estimate: PoseEstimate | None
    accepted: bool
    reason: str
    cost_before: float
    cost_after: float
    support: EdgeSupport
    timings_s: dict[str, float] = field(default_factory=dict)


class EdgeReader:
    """Reads the edges in a set of views along the contour at any pose near the present one.

    Args:
        backgrounds: The pictures and what is behind the arm.
        ignore: Per view ``(H, W)`` bool where the image says nothing, or None.
    """

    def __init__(
        self, backgrounds: Backgrounds, ignore: Sequence[NDArray[np.bool_] | None] | None = None
    ) -> None:
        self.backgrounds = backgrounds
        self.scene = backgrounds.scene
        self.ignore = ignore
        sigma = _BLUR_PX / STEP
        half = int(np.ceil(2.5 * sigma))
        k = np.arange(-half, half + 1)
        taps = k * np.exp(-0.5 * np.square(k / sigma))
        # Scaled so that a ramp of one unit per pixel gives one.
        self.taps = taps / (np.sum(taps * k) * STEP)

    def read(
        self, T_mount_cam: F64, reach_px: float, *, spacing_px: float = 1.0
    ) -> list[EdgeReading]:
        """Edges of all views within ``reach_px`` of the contour at a pose."""
        shown = self.scene.contours(inverse(T_mount_cam), 1, spacing=spacing_px)

        def one(view: int) -> EdgeReading:
            contour, coverage = shown[view]
            n = len(contour)
            offset, contrast, kind = np.zeros(n), np.zeros(n), np.zeros(n, np.int8)
            find_edges(
                self.backgrounds.values[view], self.backgrounds.plates[view],
                (coverage > 0.5).astype(np.uint8), contour.points, contour.normals,
                float(reach_px), self.taps, self.backgrounds.noise,
                offset, contrast, kind,
            )  # fmt: skip
            if self.ignore is not None and self.ignore[view] is not None and n:
                x, y = np.round(contour.points).astype(np.int64).T
                kind[self.ignore[view][y, x]] = NONE
            return EdgeReading(contour, offset, kind, contrast)

        return parallel_map(one, range(len(self.scene)))

    def support(self, T_mount_cam: F64) -> EdgeSupport:
        """How well the images bear out a pose."""
        readings = self.read(T_mount_cam, 4.0, spacing_px=2.0)
        near = [r.found & (np.abs(r.offset) < 1.5) for r in readings]
        total = sum(len(n) for n in near)
        covers = self.scene.coverages(inverse(T_mount_cam), 8)
        return EdgeSupport(
            share=float(sum(n.sum() for n in near)) / max(total, 1),
            length_px=2.0 * total,
            covered=float(covers.mean()),
            views=np.array([float(n.mean()) if len(n) else np.nan for n in near]),
        )


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
    T = start.T_mount_cam
    for reach in config.reaches_px:
        T = _descend(reader, T, reach, config, trust)
    fit = _Fit.at(reader, T, config, trust)
    if fit is None:
        return EdgeRefinement(
            start, False, "Too few edges of the arm were found in the images.",
            1.0, 1.0, reader.support(start.T_mount_cam),
        )  # fmt: skip
    before, after = _held_out(reader, start.T_mount_cam, fit, config, trust)
    accepted = after < before
    reason = (
        f"Contour points that the fit did not see lie closer to the edges than before: "
        f"cost {after:.3f} instead of {before:.3f}."
        if accepted
        else "Contour points that the fit did not see lie no closer to the edges than before: "
        f"cost {after:.3f} against {before:.3f}."
    )
    names = tuple(ids) if ids is not None else tuple(str(i) for i in range(len(scene)))
    estimate = fit.estimate(scene, start, names, trust) if accepted else start
    took = {"edges": time.perf_counter() - clock}
    if accepted:
        estimate = replace(estimate, timings_s={**start.timings_s, **took})
    return EdgeRefinement(
        estimate, accepted, reason, before, after, reader.support(estimate.T_mount_cam), took
    )


def _descend(
    reader: EdgeReader, T_mount_cam: F64, reach: float, config: EdgeConfig, trust: F64
) -> F64:
    """Robust Gauss-Newton with a scale that shrinks with the reach."""
    scene = reader.scene
    T = inverse(T_mount_cam)
    for _ in range(config.steps):
        readings = reader.read(inverse(T), reach, spacing_px=2.0 * config.spacing_px)
        J, r, w, _ = _stacked(readings, trust, _scale(readings, reach))
        if np.count_nonzero(w) < _FEWEST:
            break
        A = np.column_stack([J, np.ones(len(J))])
        H = A.T @ (w[:, None] * A)
        H[:6, :6] += 1e-6 * np.diag(np.diag(H[:6, :6]))
        H[6, 6] += w.sum() * 0.1
        step = np.linalg.solve(H, A.T @ (w * r))[:6]
        T = perturb_about(T, scene.centre_cam(T), step)
        if float(np.sqrt(np.mean(np.square(J @ step)))) < 0.02:
            break
    return inverse(T)


def _scale(readings: Sequence[EdgeReading], reach: float) -> float:
    """Standard deviation of the good edges' offsets, pixels."""
    found = [np.abs(r.offset[r.found]) for r in readings]
    pooled = np.concatenate(found) if found else np.zeros(0)
    if len(pooled) == 0:
        return reach
    return float(np.clip(1.4826 * np.median(pooled), _SMALLEST_SCALE_PX, 0.5 * reach))


def _edge_weights(reading: EdgeReading, scale: float) -> F64:
    """Tukey's weights; edges found from colour alone count half."""
    u = np.clip(np.abs(reading.offset) / (4.685 * scale), 0.0, 1.0)
    w = np.square(1.0 - np.square(u))
    return np.where(reading.kind == AGAINST_PLATE, 1.0, 0.5) * w * reading.found


def _stacked(
    readings: Sequence[EdgeReading], trust: F64, scale: float
) -> tuple[F64, F64, F64, NDArray[np.int64]]:
    J = np.concatenate([r.contour.jacobians for r in readings])
    offset = np.concatenate([r.offset for r in readings])
    w = np.concatenate([t * _edge_weights(r, scale) for r, t in zip(readings, trust, strict=True)])
    view = np.concatenate([np.full(len(r.offset), i) for i, r in enumerate(readings)])
    return J, offset, w, view


@dataclass(frozen=True)
class _Fit:
    """The generalised least squares solution at the end."""

    T_mount_cam: F64
    centre_cam: F64
    covariance: F64
    information: F64
    vectors: F64
    dilation: float
    noise: NoiseModel
    readings: list[EdgeReading]
    weights: list[F64]

    @classmethod
    def at(
        cls, reader: EdgeReader, T_mount_cam: F64, config: EdgeConfig, trust: F64
    ) -> _Fit | None:
        """Two rounds: the noise model is fitted to the residuals, then the pose with it."""
        scene = reader.scene
        T = inverse(T_mount_cam)
        for last in (False, True):
            readings = reader.read(inverse(T), config.reaches_px[-1], spacing_px=config.spacing_px)
            scale = _scale(readings, config.reaches_px[-1])
            weights = [_edge_weights(r, scale) for r in readings]
            points = [_points(r, w) for r, w in zip(readings, weights, strict=True)]
            if sum(len(p) for p in points) < _FEWEST // 3:
                return None
            noise = fit_noise(points, trust)
            information, vectors = _information(points, noise, trust)
            N = information.sum(axis=0)
            N[6, 6] += 1.0 / _DILATION_PRIOR_PX**2
            if np.linalg.cond(N) > 1e16:
                return None
            solution = np.linalg.solve(N, vectors.sum(axis=0))
            centre = scene.centre_cam(T)
            if not last:
                T = perturb_about(T, centre, solution[:6])
        covariance = COVARIANCE_INFLATION * between_views(N, information, vectors, solution)[:6, :6]
        return cls(
            inverse(T), centre, covariance, information, vectors, float(solution[6]), noise,
            readings, weights,
        )  # fmt: skip

    def estimate(
        self, scene: Scene, start: PoseEstimate, ids: Sequence[str], trust: F64
    ) -> PoseEstimate:
        """As the solver states its poses, in the same convention."""
        known = {v.id: v for v in start.views}
        views, contours = [], []
        for i, (r, w) in enumerate(zip(self.readings, self.weights, strict=True)):
            total = float(w.sum())
            n = max(len(w), 1)
            off = np.abs(r.offset[r.found])
            views.append(
                ViewFit(
                    id=ids[i],
                    weight=float(trust[i]) * total / n,
                    rms_px=float(np.sqrt((w * r.offset**2).sum() / total)) if total > 0 else 0.0,
                    iou=known[ids[i]].iou if ids[i] in known else float("nan"),
                    contour_px=float(len(w) * r.contour.spacing),
                    outliers=float(np.mean(w < 0.25)) if len(w) else 0.0,
                    outlier_px=float(np.median(off)) if len(off) else 0.0,
                    noise_px=self.noise.sigma_px * float(self.noise.view_scale[i]),
                    flags=known[ids[i]].flags if ids[i] in known else (),
                )
            )
            keep = r.found
            contours.append(
                ContourFit(
                    points=r.contour.points[keep],
                    normals=r.contour.normals[keep],
                    residuals=r.offset[keep],
                    distances=r.offset[keep],
                    weights=w[keep],
                    jacobians=r.contour.jacobians[keep],
                    links=r.contour.links[keep],
                )
            )
        return PoseEstimate(
            T_mount_cam=self.T_mount_cam,
            covariance=pose_covariance_from_centred(self.covariance, self.centre_cam),
            views=tuple(views),
            dilation_px=self.dilation,
            status="converged",
            message="The pose settled on the edges in the images.",
            centre_cam=self.centre_cam,
            contours=tuple(contours),
            information=self.information,
            vectors=self.vectors,
        )


def _points(reading: EdgeReading, weights: F64) -> ContourPoints:
    c = reading.contour
    evidence = Evidence(
        contour=c, points=c.points, jacobians=c.jacobians, residuals=reading.offset,
        distances=reading.offset, length=c.spacing, mismatch=0.0, iou=0.0,
    )  # fmt: skip
    return average_samples(evidence, weights)


def _information(points: Sequence[ContourPoints], noise: NoiseModel, trust: F64) -> tuple[F64, F64]:
    """Per view information ``(V, 7, 7)`` on [delta, dilation], and vectors ``(V, 7)``."""

    def one(view: int) -> tuple[F64, F64]:
        p = points[view]
        if len(p) == 0:
            return np.zeros((7, 7)), np.zeros(7)
        A = np.column_stack([p.jacobians, np.ones(len(p))])
        factor = cho_factor(noise.covariance(p, view), lower=True, check_finite=False)
        CA = cho_solve(factor, np.column_stack([A, p.residuals]), check_finite=False)
        return trust[view] * (A.T @ CA[:, :7]), trust[view] * (A.T @ CA[:, 7])

    parts = parallel_map(one, range(len(points)))
    return np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])


def between_views(N: F64, information: F64, vectors: F64, solution: F64) -> F64:
    """Covariance ``(7, 7)`` that honours how much the views contradict each other.

    The noise along a contour says nothing of errors that a whole view or link shares: joints a
    fraction of a degree off, a clock out of step, a lens not quite as stated. They show in that
    the views pull the common pose apart. Along each direction the spread of the views' pulls is
    compared with what the noise model expects (White's sandwich), drawn towards the expectation
    as if six more views had agreed with it, and never taken below it.

    Args:
        N: ``(7, 7)`` the information of all, with the prior.
        information: ``(V, 7, 7)`` and ``vectors`` ``(V, 7)`` of the views.
        solution: ``(7,)`` the solution of all.
    """
    inverse_N = np.linalg.inv(N)
    used = np.einsum("vii->v", information) > 0
    n = int(np.count_nonzero(used))
    if n < 3:
        return inverse_N
    root = np.linalg.cholesky(0.5 * (inverse_N + inverse_N.T))
    pulls = (vectors - information @ solution)[used] @ root
    # Whitened: the sum of the pulls' squares is the identity where the noise model is right.
    spread = pulls.T @ pulls * (n / (n - 1.0))
    values, axes = np.linalg.eigh((n * spread + 6.0 * np.eye(7)) / (n + 6.0))
    return root @ (axes * np.maximum(values, 1.0)) @ axes.T @ root.T


def _held_out(
    reader: EdgeReader, T_start: F64, fit: _Fit, config: EdgeConfig, trust: F64
) -> tuple[float, float]:
    """Robust cost of contour points that a fit has not seen, at the start and at the fit.

    The contour is cut into squares of 40 px, painted like a chessboard. The pose is fitted to one
    colour and judged on the other, and the other way round. At either pose the edges are looked
    for anew, with the same reach and the same scale, so that neither has the home advantage.
    """
    reach = config.reaches_px[0]
    at_start = reader.read(T_start, reach, spacing_px=2.0)
    at_fit = reader.read(fit.T_mount_cam, reach, spacing_px=2.0)
    scale = _scale(at_fit, config.reaches_px[-1])
    before, after, count = 0.0, 0.0, 0
    # The dilation is the images' affair, not the pose's: it is taken out of both.
    J, r, w, _ = _stacked(at_fit, trust, scale)
    colour = np.concatenate([_chessboard(e.contour.points) for e in at_fit])
    found = np.concatenate([e.found for e in at_fit])
    for side in (0, 1):
        seen = (colour == side) & (w > 0)
        if np.count_nonzero(seen) < _FEWEST // 2:
            return 1.0, 1.0
        A = np.column_stack([J[seen], np.ones(np.count_nonzero(seen))])
        H = A.T @ (w[seen, None] * A) + 1e-6 * np.diag(np.diag(A.T @ (w[seen, None] * A)))
        H[6, 6] += 0.1 * w[seen].sum()
        step = np.linalg.solve(H, A.T @ (w[seen] * r[seen]))
        unseen = (colour != side) & found
        left = r[unseen] - J[unseen] @ step[:6]
        after += float(np.sum(_cost(left, scale)))
        count += int(np.count_nonzero(unseen))
    n_start = 0
    for e in at_start:
        before += float(np.sum(_cost(e.offset[e.found], scale)))
        n_start += int(np.count_nonzero(e.found))
    return before / max(n_start, 1), after / max(count, 1)


def _chessboard(points: F64) -> NDArray[np.int64]:
    cell = np.floor(points / _CELL_PX).astype(np.int64)
    return (cell[:, 0] + cell[:, 1]) % 2


def _cost(offset: F64, scale: float) -> F64:
    """Tukey's cost, 0..1."""
    u = np.clip(np.abs(offset) / (4.685 * scale), 0.0, 1.0)
    return 1.0 - np.power(1.0 - np.square(u), 3)


def pose_shift(a: F64, b: F64) -> F64:
    """Tangent ``[v, w]`` ``(6,)`` from pose ``a`` to pose ``b``: ``a @ exp([v, w]) = b``."""
    return log_se3(inverse(a) @ b)
