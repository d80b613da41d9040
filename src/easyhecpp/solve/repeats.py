"""The same mask error in every view.

What stands still, above all the robot's base, shows the same pixels before the same background in
every picture, and a segmenter gets them wrong in the same way: on recordings four fifths of the
variance of such errors is common to all views. Ten pictures of the base then say hardly more than
one. How much is shared is measured: masks whose errors are independent lose nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from easyhecpp.solve.correlation import ContourPoints

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_NEAR_PX, _ALIKE, _ANOTHER_LINK = 6.0, 0.4, 100.0
"""How near, how alike in direction (a difference of unit normals) points of one link must be."""

_PAIRS_PER_ERROR = 10.0
"""Neighbouring points err together; so many pairs count as one when the share is tested."""


@dataclass(frozen=True)
class Repeats:
    """Which points of different views show the same piece of outline.

    Attributes:
        first, second: ``(P,)`` pairs of points of different views, as indices into all points.
        starts: ``(V + 1,)`` where each view's points start among them.
    """

    first: I64
    second: I64
    starts: I64

    @classmethod
    def among(cls, views: Sequence[ContourPoints], trust: F64) -> Repeats:
        """Find them.

        Args:
            views: Points of each view.
            trust: ``(V,)`` weight of each view; one of weight 0 shows nothing.
        """
        sizes = np.array([len(v) for v in views])
        view = np.repeat(np.arange(len(views)), sizes)
        places = np.concatenate(
            [
                np.column_stack([v.points / _NEAR_PX, v.normals / _ALIKE, v.links * _ANOTHER_LINK])
                for v in views
            ]
        )
        pairs = KDTree(places).query_pairs(1.0, output_type="ndarray")
        across = view[pairs[:, 0]] != view[pairs[:, 1]]
        counted = (trust[view[pairs]] > 0.0).all(axis=1)
        pairs = pairs[across & counted]
        return cls(pairs[:, 0], pairs[:, 1], np.concatenate([[0], np.cumsum(sizes)]))

    def others(self) -> list[F64]:
        """For every point of every view the number of other views that show it too."""
        n = int(self.starts[-1])
        view = np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))
        ends = np.concatenate([self.first, self.second])
        shown_by = view[np.concatenate([self.second, self.first])]
        point = np.unique(ends * len(self.starts) + shown_by) // len(self.starts)
        count = np.bincount(point, minlength=n).astype(np.float64)
        return [count[a:b] for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)]

    def shared(self, residuals: Sequence[F64]) -> float:
        """Share of the errors' variance, from 0 to 1, that views of the same outline have alike.

        A lower bound by one standard deviation, so that chance does not take say from independent
        masks.

        Args:
            residuals: Of the points of each view at the best pose.
        """
        r = np.concatenate(residuals)
        a, b = r[self.first], r[self.second]
        squares = 0.5 * float((a * a + b * b).sum())
        if squares <= 0.0:
            return 0.0
        doubt = np.sqrt(_PAIRS_PER_ERROR / len(a))
        return float(np.clip(float((a * b).sum()) / squares - doubt, 0.0, 1.0))
