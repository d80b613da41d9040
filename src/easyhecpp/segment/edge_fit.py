"""The pose from edge offsets by generalised least squares, with an honest covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from easyhecpp._parallel import parallel_map
from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, perturb_about, pose_covariance_from_centred
from easyhecpp.segment._edge_kernel import AGAINST_PLATE
from easyhecpp.segment.edge_reading import EdgeReader, EdgeReading
from easyhecpp.segment.edge_sources import EdgePoints, Sources
from easyhecpp.segment.scene import Scene
from easyhecpp.solve.all_unknowns import intrinsic_columns
from easyhecpp.solve.between_views import between_views
from easyhecpp.solve.correlation import NoiseModel, fit_noise
from easyhecpp.solve.joint_noise import UNDERSTATED, JointNoise
from easyhecpp.solve.joint_offsets import FreedStep, JointOffsets, freed_step, offsets_asked
from easyhecpp.solve.joint_twists import joint_twists
from easyhecpp.solve.lens import LensStrain, lens_strain
from easyhecpp.solve.types import ContourFit, PoseEstimate, ViewFit

F64 = NDArray[np.float64]

COVARIANCE_INFLATION = 1.5
"""On the covariance of the edge fit, for what its noise model leaves out."""

FEWEST = 60
"""Contour samples with an edge under which nothing is fitted."""

_DILATION_PRIOR_PX = 0.15
"""Edges common to all contours: sharpening halos and the lens' blur, not a segmenter's habits."""

_POSE, _INTRINSICS, _LENS = 7, 3, slice(8, 10)
"""Unknowns of the pose (``delta`` and the dilation); then focal length, ``k1`` and ``k2``, which
are not solved for, but tested for what they would explain; the joints come last."""

_SMALLEST_SCALE_PX = 0.25
_BLUR_PX = 1.0


def offset_scale(readings: Sequence[EdgeReading], reach: float) -> float:
    """Standard deviation of the good edges' offsets, pixels."""
    found = [np.abs(r.offset[r.found]) for r in readings]
    pooled = np.concatenate(found) if found else np.zeros(0)
    if len(pooled) == 0:
        return reach
    return float(np.clip(1.4826 * np.median(pooled), _SMALLEST_SCALE_PX, 0.5 * reach))


def _edge_weights(reading: EdgeReading, scale: float) -> F64:
    """Tukey's weights."""
    u = np.clip(np.abs(reading.offset) / (4.685 * scale), 0.0, 1.0)
    return np.square(1.0 - np.square(u)) * reading.found


def counts(readings: Sequence[EdgeReading], trust: F64) -> list[F64]:
    """How much each sample counts: what stands still is the same edge again in every view."""
    shows = max(1, sum(t > 0 and len(r.offset) > 0 for t, r in zip(trust, readings, strict=True)))
    return [
        t * r.found * np.where(r.kind == AGAINST_PLATE, 1.0, 1.0 / shows)
        for t, r in zip(trust, readings, strict=True)
    ]


def stacked(readings: Sequence[EdgeReading], trust: F64, scale: float) -> tuple[F64, F64, F64]:
    """Jacobians ``(N, 6)``, offsets ``(N,)`` and weights ``(N,)`` of all views."""
    J = np.concatenate([r.contour.jacobians for r in readings])
    offset = np.concatenate([r.offset for r in readings])
    weights = [
        c * _edge_weights(r, scale) for c, r in zip(counts(readings, trust), readings, strict=True)
    ]
    return J, offset, np.concatenate(weights)


@dataclass(frozen=True)
class EdgeFit:
    """The generalised least squares solution.

    Attributes:
        T_mount_cam: ``(4, 4)``.
        centre_cam: ``(3,)`` the point that ``delta`` turns about.
        step: ``(6,)`` the ``delta`` to a better pose, tiny once settled.
        covariance: ``(6, 6)`` of ``delta``.
        information, vectors: ``(V, 10 + n, 10 + n)`` and ``(V, 10 + n)`` of each view on
            ``[delta, dilation, focal, k1, k2, joints]``; 0 for those that do not count.
        dilation: Displacement common to all edges, pixels.
        noise: Errors along the contour.
        sources: Errors that links and postures share.
        readings, weights: The edges at the solution and the say that each sample has.
        lens: What the edges say about the lens.
        by_lens: ``(6, 2)`` how ``delta`` follows ``k1`` and ``k2``.
        joint_noise: Standard deviation of the joints, fresh in every view, rad (m).
    """

    T_mount_cam: F64
    centre_cam: F64
    step: F64
    covariance: F64
    information: F64
    vectors: F64
    dilation: float
    noise: NoiseModel
    sources: Sources
    readings: list[EdgeReading]
    weights: list[F64]
    lens: LensStrain
    by_lens: F64
    joint_noise: float

    @classmethod
    def at(
        cls,
        reader: EdgeReader,
        T_mount_cam: F64,
        reach_px: float,
        spacing_px: float,
        trust: F64,
    ) -> EdgeFit | None:
        """What the edges about a pose that is all but right say of it, and of the step to a better.

        None when too few edges are found.
        """
        scene = reader.scene
        T = inverse(T_mount_cam)
        centre = scene.centre_cam(T)
        readings = reader.read(T_mount_cam, reach_px, spacing_px=spacing_px)
        scale = offset_scale(readings, reach_px)
        weights = [_edge_weights(r, scale) for r in readings]
        twists = joint_twists(scene.rig, scene.joints, T, centre)
        points = parallel_map(
            lambda rwt: EdgePoints.averaged(*rwt),
            list(zip(readings, weights, twists, strict=True)),
        )
        if sum(len(p) for p in points) < FEWEST // 3:
            return None
        sources = Sources.fitted(points, trust)
        left = parallel_map(sources.removed, points)
        noise = fit_noise(left, trust, _BLUR_PX)
        whole, sides = _information(points, noise, sources, trust, scene.camera)
        count = np.array([len(p) > 0 for p in points]) & (trust > 0.0)
        prior = _prior()
        posed = whole[count, :-_INTRINSICS, :-_INTRINSICS]
        joint_noise = JointNoise().fitted(posed, sides[count, :-_INTRINSICS], prior)
        of_pose, pulls = whole[:, :_POSE, :_POSE], sides[:, :_POSE]
        N = of_pose.sum(axis=0) + prior
        if np.linalg.cond(N) > 1e16:
            return None
        solution = np.linalg.solve(N, pulls.sum(axis=0))
        spread = between_views(N, N + joint_noise.pulls(posed), of_pose, pulls, solution)
        order = np.r_[:_POSE, -_INTRINSICS:0, _POSE : posed.shape[1]]
        information, vectors = whole[:, order[:, None], order], sides[:, order]
        return cls(
            T_mount_cam=T_mount_cam,
            centre_cam=centre,
            step=solution[:6],
            covariance=COVARIANCE_INFLATION * spread[:6, :6],
            information=information,
            vectors=vectors,
            dilation=float(solution[6]),
            noise=noise,
            sources=sources,
            readings=readings,
            weights=weights,
            lens=lens_strain(information[count], vectors[count], prior, COVARIANCE_INFLATION),
            by_lens=-np.linalg.solve(N, information[:, :_POSE, _LENS].sum(axis=0))[:6],
            joint_noise=float(np.sqrt(UNDERSTATED * joint_noise.variance)),
        )

    def moved(self, step: F64) -> F64:
        """``(4, 4)`` pose after a ``delta``, ``(6,)``."""
        return inverse(perturb_about(inverse(self.T_mount_cam), self.centre_cam, step))

    def settled(self) -> F64:
        """``(4, 4)`` pose that the edges ask for."""
        return self.moved(self.step)

    def with_lens(self) -> F64:
        """``(4, 4)`` pose that goes with the lens that the edges ask for."""
        return self.moved(self.step + self.by_lens @ self.lens.k)

    def offsets_asked(self, scene: Scene) -> JointOffsets:
        """What the joints are off by in all views alike, as far as the edges ask for it.

        Args:
            scene: With the joints as recorded.
        """
        robot = scene.rig.robot
        return offsets_asked(
            self.information, self.vectors, _prior(), sag=robot.sag(scene.joints),
            joint_names=robot.joint_names,
        )  # fmt: skip

    def freed(self, *, lens: bool, offsets: JointOffsets, values: F64) -> FreedStep:
        """The step with the joints' offsets free, and the lens where that is wanted.

        Args:
            lens: Whether ``k1`` and ``k2`` are free.
            offsets: What the joints may be off by.
            values: ``(m,)`` what this fit takes the offsets to be.
        """
        return freed_step(
            self.information, self.vectors, _prior(),
            lens=lens, offsets=offsets, values=values, inflation=COVARIANCE_INFLATION,
        )  # fmt: skip

    def with_doubt(self, covariance: F64) -> EdgeFit:
        """The same, its error bar widened by ``(6, 6)`` for what is not known beside the pose."""
        return replace(self, covariance=self.covariance + covariance)

    def with_lens_doubt(self) -> EdgeFit:
        """The same, the lens having been refined too: what is not known of it widens the bar."""
        return self.with_doubt(self.by_lens @ self.lens.covariance @ self.by_lens.T)

    def estimate(
        self, start: PoseEstimate, ids: Sequence[str], trust: F64, *, offset: bool
    ) -> PoseEstimate:
        """As the solver states its poses, in the same convention.

        Args:
            start: The pose from the masks.
            ids: Names of the views.
            trust: ``(V,)`` in each view.
            offset: Whether joints were found to be off in all views alike.
        """
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
                    # What shows no edge at all is counted by the edges' support.
                    outliers=float(np.mean(w[r.found] < 0.25)) if r.found.any() else 0.0,
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
            information=self.information[:, :_POSE, :_POSE],
            vectors=self.vectors[:, :_POSE],
            # What masks see of the joints counts, except for what sag and better zeros explain.
            joint_noise=min(start.joint_noise, self.joint_noise) if offset else start.joint_noise,
        )


def _prior() -> F64:
    """``(7, 7)`` information on ``[delta, dilation]`` before any edge is seen."""
    return np.diag([0.0] * 6 + [1.0 / _DILATION_PRIOR_PX**2])


def _information(
    views: Sequence[EdgePoints], noise: NoiseModel, sources: Sources, trust: F64, camera: Camera
) -> tuple[F64, F64]:
    """Information ``(V, k, k)`` of each view, and vectors ``(V, k)``.

    Of [delta, dilation, joints, focal length, k1, k2].
    """
    # In every view an edge that never moves is the same measurement again.
    repeats = max(1, sum(t > 0.0 and len(v) > 0 for t, v in zip(trust, views, strict=True)))

    def one(index: int) -> tuple[F64, F64]:
        view = views[index]
        if len(view) == 0 or trust[index] <= 0.0:
            k = _POSE + view.joints.shape[1] + _INTRINSICS
            return np.zeros((k, k)), np.zeros(k)
        p = view.points
        C = noise.covariance(p, index) + sources.covariance(view)
        scale = np.where(view.still, np.sqrt(repeats), 1.0)
        C *= scale[:, None] * scale[None]
        focal_and_lens = intrinsic_columns(camera, p.points, p.normals)[:, [0, 3, 4]]
        A = np.column_stack([p.jacobians, np.ones(len(p)), view.joints, focal_and_lens])
        factor = cho_factor(C, lower=True, check_finite=False)
        CA = cho_solve(factor, np.column_stack([A, p.residuals]), check_finite=False)
        return trust[index] * (A.T @ CA[:, :-1]), trust[index] * (A.T @ CA[:, -1])

    parts = parallel_map(one, range(len(views)))
    return np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])
