"""The first pose by rendering the arm from sampled viewpoints (paper, section III-C.1).

The paper takes the best mask IoU on a fixed grid at one metre. Here the distance need not be known
and the arm need be neither centred nor wholly in view: every seed is turned and moved along its
line of sight until position and size of the rendered masks agree with the observed ones, and only
then scored; the best are refined on small images, and the best of these on larger ones.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map, usable_cores
from easyhecpp.camera import Camera
from easyhecpp.errors import NothingSuitsError
from easyhecpp.geometry import inverse, pose_error, rotation_angle
from easyhecpp.initialise._seed_kernel import fit_seeds, overlap
from easyhecpp.initialise.seeds import default_seeds, paper_seeds, seeds_between, turned_seeds
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.rig import Rig
from easyhecpp.solve import Observation
from easyhecpp.solve.descend import Level, descend
from easyhecpp.solve.problem import PoseProblem

F64 = NDArray[np.float64]

SEED_WIDTH_PX = 160
"""Image width, about, at which seeds are scored."""

_SEED_VIEWS, _SHORTLIST_VIEWS = 3, 8
_SHORTLIST, _REFINED, _FINALISTS = 64, 14, 4
_SHORTLIST_AGAIN, _REFINED_AGAIN = 160, 80
_STANDS_OUT = 0.5
"""A pose stands out that leaves at most this share of what the second best leaves unexplained (one
minus the IoU). Where none does, the search is widened: under few views the true pose's seed may
rank far down until it is refined."""
_GOOD = 0.9
"""IoU above which no camera is looked for that is turned about its axis by more than 45 degrees."""
_SAME_BASIN_DEG, _SAME_BASIN_RATIO = 6.0, 0.08


@dataclass(frozen=True)
class SamplingConfig:
    """Settings of the first pose.

    Attributes:
        grid: ``sphere`` (all around, any distance) or ``paper`` (the paper's 96 poses at 1 m,
            best mean IoU, then refined).
    """

    grid: Literal["sphere", "paper"] = "sphere"


@dataclass(frozen=True)
class InitialPose:
    """The first pose.

    Attributes:
        T_mount_cam: ``(4, 4)`` camera in the mount.
        score: Mean IoU of rendered and observed masks, in [0, 1].
        candidates: All refined poses, one per basin, best first, with their scores; on the paper's
            grid its own choice first.
        margin: Score of the first candidate minus that of the second, not below 0; 1 when there is
            no other.
        timings_s: Seconds per stage.
    """

    T_mount_cam: F64
    score: float
    candidates: tuple[tuple[F64, float], ...]
    margin: float
    timings_s: dict[str, float] = field(default_factory=dict)


def sample_initial_pose(
    rig: Rig,
    camera: Camera,
    observations: Sequence[Observation],
    config: SamplingConfig | None = None,
    rng: np.random.Generator | None = None,
) -> InitialPose:
    """Find the camera with no initial guess.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        observations: Views with masks.
        config: Settings.
        rng: Shifts the grid of seeds by a random azimuth; without it the grid stays.

    Raises:
        NothingSuitsError: No view shows the arm.
    """
    config = config or SamplingConfig()
    clock = time.perf_counter()
    usable = [o for o in observations if o.mask.any()]
    if not usable:
        raise NothingSuitsError(
            "The arm cannot be seen in any view",
            expected="masks with at least some pixels of the arm",
            fix="check the masks, or the images they were made from",
        )
    coarse_rig = Rig(rig.robot.simplified(0.006 * rig.robot.reach), rig.setup, rig.ee_link)
    problem = PoseProblem(coarse_rig, camera, usable)
    timings = {"prepare": time.perf_counter() - clock}
    clock = time.perf_counter()
    seeds = _seeds(rig, problem, config, rng)
    ranked: list[tuple[F64, float]] = []
    if config.grid == "paper":
        shortlist = _SeedScorer(problem, len(problem)).rank(seeds, rounds=0)
    else:
        ranked = _SeedScorer(problem, _SEED_VIEWS).rank(seeds, rounds=3)
        shortlist = _ranked_again(problem, ranked[:_SHORTLIST])
    timings["seeds"] = time.perf_counter() - clock
    clock = time.perf_counter()
    basins = _basins(problem, shortlist[:_REFINED])
    if config.grid == "paper":
        # The paper's answer is the grid's best pose, whatever becomes of the others; those tell
        # how sure it is.
        (chosen,) = _basins(problem, shortlist[:1])
        basins = [chosen, *(b for b in basins if not _same_basin(chosen[0], b[0]))]
    timings["refine"] = time.perf_counter() - clock
    if ranked and not _stands_out(basins):
        clock = time.perf_counter()
        place = problem.centre_mount, 2.0 * rig.robot.reach
        seeds = seeds_between(*place)
        if basins[0][1] < _GOOD:
            seeds = np.concatenate([seeds, turned_seeds(*place)])
        more = _SeedScorer(problem, _SEED_VIEWS).rank(_turned(seeds, problem, rng), rounds=3)
        ranked = sorted([*ranked, *more], key=lambda x: -x[1])
        shortlist = _ranked_again(problem, ranked[:_SHORTLIST_AGAIN])
        basins = _distinct([*basins, *_basins(problem, shortlist[:_REFINED_AGAIN])])
        timings["again"] = time.perf_counter() - clock
    return InitialPose(
        T_mount_cam=basins[0][0],
        score=basins[0][1],
        candidates=tuple(basins),
        margin=max(0.0, basins[0][1] - basins[1][1]) if len(basins) > 1 else 1.0,
        timings_s=timings,
    )


def _basins(
    problem: PoseProblem, shortlist: Sequence[tuple[F64, float]]
) -> list[tuple[F64, float]]:
    """The best seeds refined, the best of these on larger images; one per basin, best first."""
    reduction = _seed_reduction(problem.camera)
    refined = _refine(problem, shortlist, reduction, 40.0)
    refined = _refine(problem, refined[:_REFINED], reduction, 12.0)
    finalists = _refine(problem, refined[:_FINALISTS], max(1, reduction // 2), 6.0)
    return _distinct(finalists + refined[_FINALISTS:])


def _stands_out(basins: Sequence[tuple[F64, float]]) -> bool:
    best, *others = (score for _, score in basins)
    return not others or 1.0 - best <= _STANDS_OUT * (1.0 - others[0])


def _ranked_again(
    problem: PoseProblem, ranked: Sequence[tuple[F64, float]]
) -> list[tuple[F64, float]]:
    """The seeds ranked by more views."""
    return _SeedScorer(problem, _SHORTLIST_VIEWS).rank(np.stack([T for T, _ in ranked]), rounds=2)


def _seed_reduction(camera: Camera) -> int:
    return max(1, round(max(camera.width, camera.height) / SEED_WIDTH_PX))


def _seeds(
    rig: Rig, problem: PoseProblem, config: SamplingConfig, rng: np.random.Generator | None
) -> F64:
    if config.grid == "paper":
        return paper_seeds(problem.centre_mount)
    return _turned(default_seeds(problem.centre_mount, 2.0 * rig.robot.reach), problem, rng)


def _turned(seeds: F64, problem: PoseProblem, rng: np.random.Generator | None) -> F64:
    """The seeds turned about the arm by a random azimuth."""
    if rng is not None:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        about = np.eye(4)
        about[:3, 3] = problem.centre_mount
        seeds = about @ turn @ inverse(about) @ seeds
    return seeds


class _SeedScorer:
    """Matches position and size of a seed's masks to the observed ones, and scores it.

    Args:
        problem: The views.
        n_views: How many of them to use; those in which the arm looks most unlike.
    """

    def __init__(self, problem: PoseProblem, n_views: int) -> None:
        reduction = _seed_reduction(problem.camera)
        views = _unlike_views(problem.Ts_mount_link, n_views)
        self._renderer: SilhouetteRenderer = problem.renderer(reduction)
        self._poses = np.ascontiguousarray(problem.Ts_mount_link[views])
        self._masks = np.stack([problem.masks[v].level(reduction).mask for v in views])
        self._observed = np.array([overlap(m, m)[:3] for m in self._masks])
        self._centre = problem.centre_mount

    def rank(self, Ts_mount_cam: F64, rounds: int) -> list[tuple[F64, float]]:
        """The adapted poses with their mean IoU, best first."""
        n = usable_cores()
        chunks = [inverse(Ts_mount_cam[i::n]) for i in range(n) if len(Ts_mount_cam[i::n])]
        scores = parallel_map(lambda chunk: self._fit(chunk, rounds), chunks)
        # Back to the order of the seeds, so that the ranking does not depend on the cores.
        found = [(np.eye(4), 0.0)] * len(Ts_mount_cam)
        for i, (chunk, score) in enumerate(zip(chunks, scores, strict=True)):
            found[i::n] = list(zip(inverse(chunk), score.tolist(), strict=True))
        return sorted(found, key=lambda x: -x[1])

    def _fit(self, Ts_cam_mount: F64, rounds: int) -> F64:
        p, r = self._renderer.packed, self._renderer
        fc, model, k, valid_radius = r.camera.numba_params()
        return fit_seeds(
            Ts_cam_mount, rounds, self._poses, self._masks, self._observed, self._centre,
            p.vertices, p.vertex_start, p.boxes, p.planes, p.faces, p.face_start, p.edges,
            p.edge_faces, p.edge_start, fc, model, k, valid_radius,
        )  # fmt: skip


def _unlike_views(Ts_mount_link: F64, n: int) -> list[int]:
    """Views whose arms are farthest from each other (farthest-point choice on link positions)."""
    shape = Ts_mount_link[..., :3, 3].reshape(len(Ts_mount_link), -1)
    chosen = [int(np.argmax(np.linalg.norm(shape - shape.mean(axis=0), axis=1)))]
    while len(chosen) < min(n, len(shape)):
        gap = np.min([np.linalg.norm(shape - shape[c], axis=1) for c in chosen], axis=0)
        gap[chosen] = -1.0
        chosen.append(int(np.argmax(gap)))
    return chosen


def _refine(
    problem: PoseProblem, poses: Sequence[tuple[F64, float]], reduction: int, scale_px: float
) -> list[tuple[F64, float]]:
    level = Level(reduction, scale_px=scale_px, spacing=0.7)
    problem.renderer(reduction)

    def one(start: tuple[F64, float]) -> tuple[F64, float]:
        T, score = start
        end = descend(problem, inverse(T), level, 8, threads=False)
        return (inverse(end.T_cam_mount), end.mean_iou) if end.mean_iou >= score else (T, score)

    return _distinct(parallel_map(one, poses))


def _distinct(poses: Sequence[tuple[F64, float]]) -> list[tuple[F64, float]]:
    """Poses best first, without those that lie in the basin of a better one."""
    kept: list[tuple[F64, float]] = []
    for T, score in sorted(poses, key=lambda x: -x[1]):
        if all(not _same_basin(T, other) for other, _ in kept):
            kept.append((T, score))
    return kept


def _same_basin(T_a: F64, T_b: F64) -> bool:
    near = pose_error(T_a, T_b)[0] < _SAME_BASIN_RATIO * float(np.linalg.norm(T_a[:3, 3]))
    return near and float(rotation_angle(T_a[:3, :3].T @ T_b[:3, :3])) < np.deg2rad(_SAME_BASIN_DEG)
