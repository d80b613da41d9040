"""Lens distortion that the intrinsics do not state, told from the outlines.

Many cameras report a lens without distortion because nobody measured it. A few tenths of a percent
at half the picture's width are several pixels, and no pose undoes them: they grow with the distance
from the centre. The outlines of an arm in many places show it. The test below asks how much better
they are explained with ``k1`` and ``k2`` free, errors of the joints integrated out, and whether a
wrong focal length would do as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import DISTORTION_MODELS, Camera
from easyhecpp.solve.joint_noise import UNDERSTATED, JointNoise

F64 = NDArray[np.float64]

LENS = ("k1", "k2")
"""Refined; the others change outlines too little to be told from them."""

LENS_PRIOR = 0.15
"""Standard deviation of ``k1`` before any picture is seen; that of ``k2`` is twice as much."""

FOCAL_PRIOR = 0.03
"""Relative standard deviation of the focal length that the lens is compared with."""

_CHANCE = 4.0
"""Chi-square of two degrees of freedom, over the inflation. Of 69 simulated calibrations through a
straight lens two exceeded it, with 4.3 and 4.5. A lens found in vain costs a wider error bar; one
that is missed, millimetres that no error bar tells of."""

_LIKELIER = 0.5
"""A lens is preferred to another focal length when it explains that share of what the latter does:
focal lengths are measured, unstated distortion was not. In 15 simulated calibrations with a focal
length 3 % wrong and a straight lens, lenses explained at most 0.38 of it."""

_FEWEST_VIEWS = 3
"""A mask's one large error, a shadow or a tool, looks like a lens to a view alone."""

_POSE = 7


@dataclass(frozen=True)
class LensStrain:
    """What the outlines say about the lens.

    Attributes:
        k: ``(2,)`` to be added to ``k1`` and ``k2``, pose free.
        covariance: ``(2, 2)`` of it.
        gain: Chi-square that it explains.
        by_focal: Chi-square that another focal length would explain in its place.
        n_views: How many views say so.
    """

    k: F64
    covariance: F64
    gain: float
    by_focal: float
    n_views: int

    @property
    def asked(self) -> bool:
        """Whether the outlines ask for another lens, and not for another focal length."""
        least = max(_CHANCE, _LIKELIER * self.by_focal)
        return self.n_views >= _FEWEST_VIEWS and self.gain > least


def bent(camera: Camera, k: F64) -> Camera:
    """The camera with more distortion.

    Args:
        camera: Intrinsics.
        k: ``(2,)`` added to ``k1`` and ``k2``.
    """
    model = "plumb_bob" if camera.distortion_model == "none" else camera.distortion_model
    coefficients = np.zeros(max(DISTORTION_MODELS[model]))
    coefficients[: len(camera.distortion)] = camera.distortion
    coefficients[:2] += k
    return replace(camera, distortion_model=model, distortion=tuple(coefficients.tolist()))


def lens_columns(camera: Camera, points: F64, normals: F64) -> F64:
    """Outward displacement of contour points by ``k1`` and ``k2``, ``(N, 2)`` pixels.

    Args:
        camera: Intrinsics.
        points: ``(N, 2)`` pixels.
        normals: ``(N, 2)`` outward.
    """
    return np.nan_to_num(np.einsum("ni,nik->nk", normals, camera.jacobian_by_k(points)))


def lens_strain(information: F64, vectors: F64, prior: F64, inflation: float) -> LensStrain:
    """Test whether the outlines ask for another lens.

    Args:
        information: ``(V, 10 + n, 10 + n)`` on ``[delta, dilation, focal, k1, k2, joints]``, of the
            views that count.
        vectors: ``(V, 10 + n)``.
        prior: ``(7, 7)`` information on ``[delta, dilation]``.
        inflation: Factor on covariances for what the noise model leaves out.
    """
    whole = np.diag([0.0] * _POSE + [FOCAL_PRIOR**-2, LENS_PRIOR**-2, (2.0 * LENS_PRIOR) ** -2])
    whole[:_POSE, :_POSE] = prior
    noise = JointNoise(shared=len(whole)).fitted(information, vectors, whole)
    noise = replace(noise, variance=UNDERSTATED * noise.variance)
    views, sides = noise.marginal(information, vectors)
    N, b = views.sum(axis=0) + whole, sides.sum(axis=0)

    def explained(*extra: int) -> tuple[float, F64, F64]:
        some = np.r_[:_POSE, list(extra)].astype(np.int64)
        covariance = np.linalg.inv(N[np.ix_(some, some)])
        solution = covariance @ b[some]
        return float(b[some] @ solution), solution[_POSE:], covariance[_POSE:, _POSE:]

    alone, _, _ = explained()
    focal, _, _ = explained(_POSE)
    lens, k, covariance = explained(_POSE + 1, _POSE + 2)
    return LensStrain(
        k=k,
        covariance=inflation * covariance,
        gain=(lens - alone) / inflation,
        by_focal=(focal - alone) / inflation,
        n_views=len(information),
    )
