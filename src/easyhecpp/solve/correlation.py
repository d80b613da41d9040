"""A model of mask errors along the contour, fitted to the residuals themselves.

Neighbouring contour points err together: a segmenter cuts a corner or swallows a shadow over tens
of pixels. Counting every point as a new measurement gives error bars ten times too small. We take
the errors of one view as a Gaussian process with covariance

    C_ij = sum_k a_k exp(-|p_i - p_j| / l_k) (1 + n_i . n_j) / 2  +  delta_ij (nugget)

over fixed lengths ``l_k``, with the variances ``a_k >= 0`` from the residuals' products. The factor
with the normals makes the two sides of a thin link err independently. It is a product of two
positive semi-definite kernels, so C always is a covariance. A fixed small part stands for what
cutting masks at one half does to edges: equal cuts leave no residual, yet the pose has an error.

Fitting a pose takes variance out of the residuals, the more the fewer views. Its share is put back
(the step of expectation maximisation): ``E[e e'] = r r' + A cov(x) A'``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from easyhecpp._parallel import parallel_map
from easyhecpp.solve.evidence import Evidence

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

LENGTHS_PX = (3.0, 8.0, 24.0, 80.0)
"""Correlation lengths of the model; wide enough apart to be told from each other."""

CELL_PX = 6.0
"""Samples of one link, one direction and one square of this size are averaged to one point."""

FLOOR_PX, FLOOR_LENGTH_PX = 0.02, 20.0
"""Standard deviation and correlation length of what thresholding leaves of an edge's place."""

_LAG_EDGES_PX = np.array([1e-6, 3.0, 6.0, 9.0, 13.0, 19.0, 28.0, 42.0, 64.0, 100.0])


@dataclass(frozen=True)
class ContourPoints:
    """Averaged contour samples of one view: about 400 points.

    Attributes:
        points: ``(N, 2)`` pixels; ``normals`` ``(N, 2)`` outward.
        jacobians: ``(N, 6)``; ``residuals`` ``(N,)`` pixels.
        weights: ``(N,)`` robust weight in (0, 1]; ``length_px`` ``(N,)`` contour averaged over.
        links: ``(N,)`` the link that each lies on.
    """

    points: F64
    normals: F64
    jacobians: F64
    residuals: F64
    weights: F64
    length_px: F64
    links: I64

    def __len__(self) -> int:
        return len(self.residuals)

    @classmethod
    def joined(cls, parts: Sequence[ContourPoints]) -> ContourPoints:
        """The points of all parts, which may be none."""
        pair, none, number = np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64)
        nothing = cls(pair, pair, np.zeros((0, 6)), none, none, none, number)
        each = [[getattr(p, f.name) for p in (nothing, *parts)] for f in fields(cls)]
        return cls(*(np.concatenate(arrays) for arrays in each))


def average_samples(evidence: Evidence, weights: F64) -> ContourPoints:
    """Average the samples that lie together; outliers (weight zero) are left out.

    Args:
        evidence: Samples of one view.
        weights: ``(N,)`` robust weights.
    """
    keep = weights > 0.05
    p, n = evidence.points[keep], evidence.contour.normals[keep]
    cell = np.floor(p / CELL_PX).astype(np.int64)
    octant = np.floor((np.arctan2(n[:, 1], n[:, 0]) + np.pi) * (4.0 / np.pi)).astype(np.int64) % 8
    link = evidence.contour.links[keep].astype(np.int64)
    key = ((link * 8 + octant) << 40) + ((cell[:, 0] + 4096) << 20) + (cell[:, 1] + 4096)
    keys, group = np.unique(key, return_inverse=True)
    w = weights[keep]
    total = np.bincount(group, w)

    def mean(values: F64) -> F64:
        columns = values.T if values.ndim == 2 else values[None]
        return np.stack([np.bincount(group, w * c) for c in columns], axis=-1) / total[:, None]

    normals = mean(n)
    norm = np.linalg.norm(normals, axis=1, keepdims=True)
    return ContourPoints(
        points=mean(p),
        normals=normals / np.maximum(norm, 1e-9),
        jacobians=mean(evidence.jacobians[keep]),
        residuals=mean(evidence.residuals[keep])[:, 0],
        weights=total / np.bincount(group),
        length_px=np.asarray(np.bincount(group) * evidence.length, np.float64),
        links=keys >> 43,
    )


@dataclass(frozen=True)
class NoiseModel:
    """Fitted variances.

    Attributes:
        variances: ``(K,)`` px^2 for each of :data:`LENGTHS_PX`.
        nugget: px^2 of a point that averages one cell's width of contour.
        view_scale: ``(V,)`` standard deviation of each view's errors relative to all.
        gain: By how much residuals follow a displacement: those of a smoothed difference saturate,
            so that noise makes them follow less.
    """

    variances: F64
    nugget: float
    view_scale: F64
    gain: float = 1.0

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the contour error at a point."""
        return float(np.sqrt(self.variances.sum() + self.nugget))

    def covariance(self, points: ContourPoints, view: int) -> F64:
        """Covariance ``(N, N)`` of the residuals of a view, px^2."""
        distance, facing = _pair_geometry(points)
        C = np.zeros_like(distance)
        for variance, length in zip(self.variances, LENGTHS_PX, strict=True):
            if variance > 0.0:
                C += variance * np.exp(-distance / length)
        C *= facing
        own = self.nugget * CELL_PX / np.maximum(points.length_px, 1e-3)
        # A robust weight under one is a larger variance of that point alone.
        own = own + self.sigma_px**2 * (1.0 / points.weights - 1.0)
        C[np.diag_indices_from(C)] += own + 1e-6
        C *= self.view_scale[view] ** 2
        return C + FLOOR_PX**2 * facing * np.exp(-distance / FLOOR_LENGTH_PX)

    def design(self, points: ContourPoints) -> F64:
        """Change of the residuals by ``[delta, dilation]``: ``(N, 7)``."""
        return self.gain * np.column_stack([points.jacobians, np.ones(len(points))])


def _pair_geometry(points: ContourPoints) -> tuple[F64, F64]:
    """Distances ``(N, N)`` pixels, and (1 + n_i . n_j) / 2."""
    p = points.points
    square = np.sum(p * p, axis=1)
    distance = np.sqrt(np.maximum(square[:, None] + square[None] - 2.0 * (p @ p.T), 0.0))
    return distance, 0.5 * (1.0 + points.normals @ points.normals.T)


def fit_noise(
    views: Sequence[ContourPoints],
    trust: F64,
    smoothing_px: float,
    taken: Sequence[F64] | None = None,
) -> NoiseModel:
    """Fit the variances to the products of residuals, over all views.

    Args:
        views: Points of each view at the best pose; a view may be empty.
        trust: ``(V,)`` weight of each view; one of weight 0 has no say.
        smoothing_px: Standard deviation of the smoothing behind the residuals.
        taken: Per view a factor ``(N, 7)`` of the covariance that the fit took out of them.
    """
    scale = _view_scales(views, trust)
    counted = [v for v, p in enumerate(views) if trust[v] > 0.0 and len(p) > 1]
    if not counted:
        return NoiseModel(np.zeros(len(LENGTHS_PX)), 1.0, scale)
    each = parallel_map(
        lambda v: _pair_products(views[v], scale[v], None if taken is None else taken[v]), counted
    )
    products = np.sum([p[0] for p in each], axis=0)
    counts = np.sum([p[1] for p in each], axis=0)
    kernels = np.sum([p[2] for p in each], axis=0)
    power = sum(p[3] for p in each)
    n_points = sum(len(views[v]) for v in counted)
    used = counts > 0
    # Short lags carry the shape, long lags the many pairs: weight by the root of the count.
    weight = np.sqrt(np.sqrt(counts[used]))
    variances, _ = nnls(
        kernels[used] / counts[used, None] * weight[:, None],
        products[used] / counts[used] * weight,
    )
    mean_power = power / n_points
    variances *= min(1.0, 0.98 * mean_power / max(variances.sum(), 1e-12))
    return NoiseModel(
        variances,
        max(mean_power - variances.sum(), 1e-4),
        scale,
        _gain(_pooled_power(views, trust), smoothing_px),
    )


def _pair_products(
    points: ContourPoints, scale: float, taken: F64 | None
) -> tuple[F64, F64, F64, float]:
    """Of the pairs of a view's points, by the distance between them (``K`` lags).

    Args:
        points: Of the view.
        scale: Standard deviation of its errors relative to all views.
        taken: See `fit_noise`.

    Returns:
        Sum ``(K,)`` of the products of their residuals, number ``(K,)`` of pairs, sum
        ``(K, len(LENGTHS_PX))`` of the correlations that each length would give, and the sum of the
        residuals' squares.
    """
    n_lags = len(_LAG_EDGES_PX) - 1
    r = points.residuals / scale
    distance, facing = _pair_geometry(points)
    i, j = np.nonzero(np.triu((distance < _LAG_EDGES_PX[-1]) & (facing > 0.75), k=1))
    d, f = distance[i, j], facing[i, j]
    lag = np.clip(np.searchsorted(_LAG_EDGES_PX, d, side="right") - 1, 0, n_lags - 1)
    product = r[i] * r[j]
    power = float(r @ r)
    if taken is not None:
        L = taken / scale
        product = product + np.einsum("nk,nk->n", L[i], L[j])
        power += float(np.square(L).sum())
    kernels = [np.bincount(lag, f * np.exp(-d / length), n_lags) for length in LENGTHS_PX]
    return (
        np.asarray(np.bincount(lag, product, n_lags), np.float64),
        np.asarray(np.bincount(lag, minlength=n_lags), np.float64),
        np.stack(kernels, axis=1).astype(np.float64),
        power,
    )


def _pooled_power(views: Sequence[ContourPoints], trust: F64) -> float:
    used = [v.residuals for v, w in zip(views, trust, strict=True) if w > 0.0]
    return float(np.mean(np.square(np.concatenate(used))))


def _gain(power: float, smoothing_px: float) -> float:
    """Mean slope of ``r = s sqrt(2 pi) (Phi(n / s) - 1/2)`` for normal n, from the variance of r.

    With ``u = var n / (s^2 + var n)``: ``var r = s^2 arcsin(u)`` and the mean slope is
    ``sqrt(1 - u)``.
    """
    return float(np.sqrt(1.0 - np.sin(min(power / smoothing_px**2, 1.3))))


def _view_scales(views: Sequence[ContourPoints], trust: F64) -> F64:
    """Standard deviation of each view relative to the pooled one, drawn towards 1."""
    spread = np.array(
        [float(np.sqrt(np.mean(v.residuals**2))) if len(v) else np.nan for v in views]
    )
    if not np.isfinite(spread[trust > 0.0]).any():
        return np.ones(len(views))
    pooled = float(np.nanmedian(spread[trust > 0.0]))
    relative = np.where(np.isfinite(spread), spread / max(pooled, 1e-9), 1.0)
    # About 20 independent stretches of contour in a view: a spread is known to some 15 %.
    return np.clip(relative, 0.7, 6.0) ** 0.8
