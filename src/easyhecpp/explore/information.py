"""How much a view would tell, before it is taken.

The optimiser's last stage solves generalised least squares on contour points (`solve.correlated`).
Their places, normals and Jacobians depend on the pose alone, not on the picture, so the information
matrix of a view that was never taken is that of the rendered arm's contour,

    I = A' C^-1 A,    A = gain [J, 1],

with ``C`` the model of the masks' correlated errors (`solve.correlation`). Correlation decides:
a long straight outline says little more than a short one, while contour on other links, on the
other side of a link, or far away is new.

For speed the arm is rendered at a quarter of the size with simplified meshes, and contour is
averaged over longer pieces than the optimiser's. Errors of a correlation length below a piece's
length then are a piece's own error, with the variance of their mean. Joints are taken at their
word.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.explore._covariance_kernel import correlated_errors
from easyhecpp.geometry import inverse, transform_points
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig
from easyhecpp.solve.correlation import CELL_PX, FLOOR_LENGTH_PX, FLOOR_PX, LENGTHS_PX

F64 = NDArray[np.float64]

RENDERED_WIDTH_PX = 320
"""Image width, about, at which the contour is taken."""

SIMPLIFIED = 0.006
"""Error of the simplified meshes as a share of the reach."""

PIECE_PX = 14.0
"""Contour is averaged over squares of this size, pixels of the full image."""

_OWN_LENGTH_PX = 16.0


@dataclass(frozen=True)
class ContourNoise:
    """Variances of the masks' errors, by default as fitted to masks of IoU 0.982 (xArm 7, 720p).

    Attributes:
        variances: px^2 for each correlation length of `solve.correlation.LENGTHS_PX`.
        nugget: px^2 of a point that averages 6 px of contour.
        gain: By how much residuals follow a displacement.
        dilation_prior_px: Standard deviation of the masks' common dilation.
    """

    variances: tuple[float, ...] = (0.03, 0.13, 0.12, 0.0)
    nugget: float = 0.006
    gain: float = 0.9
    dilation_prior_px: float = 0.5


class ViewPredictor:
    """Predicts the information of views.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        noise: Of the masks.
    """

    def __init__(self, rig: Rig, camera: Camera, noise: ContourNoise | None = None) -> None:
        self.noise = noise or ContourNoise()
        self._reduction = max(1, round(max(camera.width, camera.height) / RENDERED_WIDTH_PX))
        robot = rig.robot.simplified(SIMPLIFIED * rig.robot.reach)
        self.rig = Rig(robot, rig.setup, rig.ee_link)
        self._renderer = SilhouetteRenderer(robot.meshes, camera.scaled(1.0 / self._reduction))

    def information(self, Ts_mount_cam: F64, joints: F64, centre_mount: F64) -> F64:
        """Information of views on ``[delta, dilation]``.

        Args:
            Ts_mount_cam: ``(H, 4, 4)`` poses that the camera may have.
            joints: ``(N, n)``.
            centre_mount: ``(3,)`` point that ``delta`` turns about.

        Returns:
            ``(N, H, 7, 7)``; zero where nothing is in view.
        """
        Ts_mount_link = self.rig.Ts_mount_link(joints)
        Ts_cam_mount = inverse(Ts_mount_cam)
        centres = transform_points(Ts_cam_mount, centre_mount)

        def one(view: int) -> F64:
            return np.stack(
                [
                    self._of_view(T @ Ts_mount_link[view], c)
                    for T, c in zip(Ts_cam_mount, centres, strict=True)
                ]
            )

        return np.stack(parallel_map(one, range(len(joints))))

    def _of_view(self, Ts_cam_link: F64, centre_cam: F64) -> F64:
        contour, _ = self._renderer.contour(Ts_cam_link, centre_cam)
        if len(contour) < 8:
            return np.zeros((7, 7))
        points, normals, jacobians, lengths = _pieces(
            (contour.points + 0.5) * self._reduction,
            contour.normals,
            contour.links,
            contour.jacobians * self._reduction,
            contour.spacing * self._reduction,
        )
        C = _covariance(points, normals, lengths, self.noise)
        A = self.noise.gain * np.column_stack([jacobians, np.ones(len(points))])
        factor = cholesky(C, lower=True, check_finite=False)
        half = solve_triangular(factor, A, lower=True, check_finite=False)
        return half.T @ half


def _pieces(
    points: F64, normals: F64, links: NDArray[np.int32], jacobians: F64, spacing: float
) -> tuple[F64, F64, F64, F64]:
    """Average the samples of one link, one direction and one square; also the length of each."""
    cell = np.floor(points / PIECE_PX).astype(np.int64)
    octant = np.floor((np.arctan2(normals[:, 1], normals[:, 0]) + np.pi) * (4.0 / np.pi))
    key = (links.astype(np.int64) * 8 + octant.astype(np.int64) % 8) << 40
    key += ((cell[:, 0] + 4096) << 20) + cell[:, 1] + 4096
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(key[order]) != 0])
    counts = np.diff(np.r_[starts, len(key)])
    columns = np.column_stack([points, normals, jacobians])[order]
    mean = np.add.reduceat(columns, starts, axis=0) / counts[:, None]
    n = mean[:, 2:4]
    n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
    return mean[:, :2], n, mean[:, 4:], counts * spacing


def _covariance(points: F64, normals: F64, lengths: F64, noise: ContourNoise) -> F64:
    """Covariance ``(N, N)`` of the pieces' errors, px^2; lower triangle."""
    variances, scales = [FLOOR_PX**2], [FLOOR_LENGTH_PX]
    own = 1e-6 + noise.nugget * CELL_PX / lengths
    for variance, length in zip(noise.variances, LENGTHS_PX, strict=True):
        if variance <= 0.0:
            continue
        if length < _OWN_LENGTH_PX:
            # Variance of the mean of an exponentially correlated error over the piece.
            r = lengths / length
            own += variance * 2.0 * (r - 1.0 + np.exp(-r)) / r**2
        else:
            variances.append(variance)
            scales.append(length)
    C = correlated_errors(points, normals, np.array(variances), np.array(scales))
    C[np.diag_indices_from(C)] += own
    return C
