"""Errors that a whole link or a whole posture shares along the edges of one view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from easyhecpp._parallel import parallel_map
from easyhecpp.render import Contour
from easyhecpp.segment._edge_kernel import AGAINST_PLATE, COLOUR
from easyhecpp.segment.edge_reading import EdgeReading
from easyhecpp.solve.correlation import ContourPoints, average_samples
from easyhecpp.solve.evidence import Evidence
from easyhecpp.solve.joint_twists import by_joints

F64 = NDArray[np.float64]

_APART_PX = 30.0
_LEAST_WEIGHT = 0.05
_JOINT_UNIT = 1e-3
_MOST_JOINT_UNITS = 10.0
"""A joint that is off by more than 10 mrad is no noise but a wrong posture."""


@dataclass(frozen=True)
class EdgePoints:
    """Averaged contour points of one view.

    Attributes:
        points: The points.
        still: ``(N,)`` whether it never moves.
        joints: ``(N, n)`` outward displacement by each joint, px per rad (or m).
    """

    points: ContourPoints
    still: NDArray[np.bool_]
    joints: F64

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def averaged(cls, reading: EdgeReading, weights: F64, twists: F64) -> EdgePoints:
        """Samples that lie together averaged: link by link, what stands still by itself.

        Args:
            reading: Of one view.
            weights: ``(N,)`` of its samples; those of next to none are left out.
            twists: ``(n, L, 6)`` of the view, see `joint_twists`.
        """
        c = reading.contour
        parts, still = [], []
        for link in np.unique(c.links):
            for kind in (AGAINST_PLATE, COLOUR):
                own = (c.links == link) & (reading.kind == kind) & (weights > _LEAST_WEIGHT)
                if not own.any():
                    continue
                contour = Contour(
                    c.points[own], c.normals[own], c.links[own], c.jacobians[own],
                    c.points_cam[own], c.spacing,
                )  # fmt: skip
                evidence = Evidence(
                    contour=contour, points=contour.points, jacobians=contour.jacobians,
                    residuals=reading.offset[own], distances=reading.offset[own], length=c.spacing,
                    mismatch=0.0, iou=0.0,
                )  # fmt: skip
                parts.append(average_samples(evidence, weights[own]))
                still.append(np.full(len(parts[-1]), kind == COLOUR))
        points = ContourPoints.joined(parts)
        joints = by_joints(points.jacobians, points.links, twists)
        return cls(points, np.concatenate([*still, np.zeros(0, np.bool_)]), joints)


@dataclass(frozen=True)
class Sources:
    """Errors that a whole link or a whole posture shares, in one view.

    Attributes:
        link: Variance of the shift of each link's outline, px^2 along each axis: meshes are made
            and covers fitted to a fraction of a millimetre.
        joint: Variance of each joint, rad^2: encoders, gears and clocks are not perfect. It grows
            towards the tip of the arm, which has less say than its root.
    """

    link: float
    joint: float

    def covariance(self, view: EdgePoints) -> F64:
        """Of the displacements of a view's points, ``(N, N)`` px^2."""
        return self.link * _link_kernel(view) + self.joint * (view.joints @ view.joints.T)

    @classmethod
    def fitted(cls, views: Sequence[EdgePoints], trust: F64) -> Sources:
        """Fit the variances to the products of residuals far apart from each other.

        Far apart, what a picture's texture does to an edge is no longer shared: only links and
        joints that are off as a whole make distant residuals alike.

        Args:
            views: Points of each view.
            trust: ``(V,)`` weight of each view; one of weight 0 has no say.
        """
        counted = [v for v, w in zip(views, trust, strict=True) if w > 0.0 and len(v) > 1]
        parts = parallel_map(_distant_products, counted)
        normal = sum((p[0] for p in parts), np.zeros((2, 2)))
        right = sum((p[1] for p in parts), np.zeros(2))
        if not normal.any():
            return cls(0.0, 0.0)
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
        solution, _ = nnls(normal / scale[:, None] / scale[None], right / scale)
        link, joint = solution / scale
        return cls(float(link), float(min(joint, _MOST_JOINT_UNITS**2)) * _JOINT_UNIT**2)

    def removed(self, view: EdgePoints) -> ContourPoints:
        """The points with the most likely shifts of links and joints taken out of the residuals."""
        p = view.points
        if len(p) == 0:
            return p
        K = self.covariance(view)
        local = K + np.eye(len(p)) * max(1.0, float(np.median(np.square(p.residuals)))) * 4.0
        return replace(p, residuals=p.residuals - K @ np.linalg.solve(local, p.residuals))


def _distant_products(view: EdgePoints) -> tuple[F64, F64]:
    """Normal equations ``(2, 2)`` and ``(2,)`` of the two variances, from points far apart."""
    p = view.points.points
    square = np.sum(p * p, axis=1)
    apart = square[:, None] + square[None] - 2.0 * (p @ p.T) > _APART_PX**2
    moving = ~view.still
    # A pair and its mirror image say the same.
    apart &= np.triu(moving[:, None] & moving[None])
    kernels = np.stack([_link_kernel(view), (view.joints @ view.joints.T) * _JOINT_UNIT**2])
    kernels = kernels[:, apart]
    # Large products come from the same few large errors: weigh by what is expected of them.
    expected = 1.0 + np.sqrt(np.sum(np.square(kernels), axis=0))
    product = np.outer(view.points.residuals, view.points.residuals)[apart]
    scaled = kernels / expected
    return scaled @ scaled.T, scaled @ (product / expected)


def _link_kernel(points: EdgePoints) -> F64:
    """Covariance of the displacements for a unit variance of each link's shift, ``(N, N)``."""
    n, links = points.points.normals, points.points.links
    return (n @ n.T) * (links[:, None] == links[None])
