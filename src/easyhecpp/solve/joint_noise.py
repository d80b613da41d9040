"""Errors of the recorded joints, a fresh one for every joint in every view.

Arms sag, gears have play, clocks run apart: the arm of a picture stands a fraction of a degree off
its recorded joints, each time another one. Such an error moves whole links at once, so no noise
along the contour describes it. It is a random effect: unknown in every view, of one variance for
all joints, which is estimated from the residuals (the evidence is maximised with pose and effects
integrated out, so few views do not make it too small).

The pose itself is solved for with the joints as recorded: on recordings it then lies nearer to what
the images' edges say. The error bars carry the joints' share.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_START, _LARGEST = 1e-3, 1e-2
"""Standard deviations in rad: to start from, and above which it is no noise but a wrong posture."""

_SMALLEST = 1e-5
_ITERATIONS = 15

UNDERSTATED = 2.0
"""True variance over the one that is found. Contours that a joint error moves far count as outliers
or reach no edge at all, and noise along the contour takes its share: of simulated 1.5 and 3 mrad,
0.9 to 1.0 and 2.0 to 2.2 are found."""


@dataclass(frozen=True)
class JointNoise:
    """Fitted variance.

    Attributes:
        variance: Of every joint, rad^2 (m^2 for prismatic ones).
        shared: Unknowns that all views share, the first of each view: ``delta`` and the dilation,
            and more where intrinsics are free too. Called s below.
    """

    variance: float = _START**2
    shared: int = 7

    def marginal(self, information: F64, vectors: F64) -> tuple[F64, F64]:
        """Information ``(V, s, s)`` and vectors ``(V, s)`` on what the views share.

        Args:
            information: ``(V, s + n, s + n)`` on ``[shared, joints of the view]``.
            vectors: ``(V, s + n)``.
        """
        s = self.shared
        _, gain = self._within(information)
        return (
            information[:, :s, :s] - gain @ information[:, s:, :s],
            vectors[:, :s] - np.einsum("vij,vj->vi", gain, vectors[:, s:]),
        )

    def effects(self, information: F64, vectors: F64, prior: F64) -> tuple[F64, F64]:
        """What all unknowns of each view most likely are, ``(V, s + n)``, and their covariance.

        Args:
            information: As for `marginal`.
            vectors: As for `marginal`.
            prior: ``(s, s)`` information on the shared unknowns before any view.
        """
        s = self.shared
        N, b = self.marginal(information, vectors)
        covariance = np.linalg.inv(N.sum(axis=0) + prior)
        shared = covariance @ b.sum(axis=0)
        within, gain = self._within(information)
        left = vectors[:, s:] - information[:, s:, :s] @ shared
        own = np.einsum("vij,vj->vi", within, left)
        slope = -gain.transpose(0, 2, 1)
        whole = np.empty_like(information)
        whole[:, :s, :s] = covariance
        whole[:, s:, :s] = slope @ covariance
        whole[:, :s, s:] = whole[:, s:, :s].transpose(0, 2, 1)
        whole[:, s:, s:] = within + slope @ covariance @ slope.transpose(0, 2, 1)
        return np.column_stack([np.broadcast_to(shared, (len(own), s)), own]), whole

    def pulls(self, information: F64) -> F64:
        """Covariance ``(s, s)`` of what joint errors add to the sum of the views' vectors.

        Of the true errors, not of the part of them that is found, see `UNDERSTATED`.

        Args:
            information: As for `marginal`; of the views that count.
        """
        s = self.shared
        by_joint = information[:, :s, s:]
        true = UNDERSTATED * self.variance
        return true * np.einsum("vij,vkj->ik", by_joint, by_joint)

    def fitted(self, information: F64, vectors: F64, prior: F64) -> JointNoise:
        """The variance that the residuals speak for, from this one.

        Args:
            information: As for `marginal`; of the views that count.
            vectors: As for `marginal`.
            prior: As for `effects`.
        """
        noise = self
        s = self.shared
        if information.shape[-1] == s or len(information) == 0:
            return noise
        for _ in range(_ITERATIONS):
            effects, spread = noise.effects(information, vectors, prior)
            own = np.square(effects[:, s:])
            # Of each unknown the share that the data determine, and not the variance assumed: with
            # it this settles far faster than expectation maximisation does (MacKay 1992, eq. 4.7).
            known = 1.0 - np.einsum("vii->vi", spread)[:, s:] / noise.variance
            variance = float(own.sum()) / max(float(known.sum()), 1e-9)
            noise = replace(noise, variance=float(np.clip(variance, _SMALLEST**2, _LARGEST**2)))
        return noise

    def log_evidence(self, information: F64, vectors: F64, prior: F64) -> float:
        """Log of how likely the residuals are, all unknowns integrated out, up to a constant.

        The constant is the same for other unknowns but for half the log determinant of the prior.

        Args:
            information: As for `marginal`; of the views that count.
            vectors: As for `marginal`.
            prior: As for `effects`.
        """
        s = self.shared
        N, b = (one.sum(axis=0) for one in self.marginal(information, vectors))
        N = N + prior
        within, _ = self._within(information)
        own = np.einsum("vi,vij,vj->", vectors[:, s:], within, vectors[:, s:])
        fit = float(b @ np.linalg.solve(N, b)) + float(own)
        # Of how much the joints' errors may be, how much is left.
        left = float(np.linalg.slogdet(within / self.variance)[1].sum())
        return 0.5 * (fit + left - float(np.linalg.slogdet(N)[1]))

    def _within(self, information: F64) -> tuple[F64, F64]:
        """Covariance ``(V, n, n)`` of the joints, the rest known, and the gain ``(V, s, n)``."""
        s = self.shared
        n = information.shape[-1] - s
        within = np.linalg.inv(information[:, s:, s:] + np.eye(n) / self.variance)
        return np.asarray(within, np.float64), information[:, :s, s:] @ within
