"""The scenes of the trust benchmark."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from easyhecpp.camera import Camera
from easyhecpp.geometry import exp_so3, make_transform
from easyhecpp.rig import Rig
from easyhecpp.sim.faults import add_blob, remove_link
from easyhecpp.sim.masks import Degradation, degrade_masks
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene, random_scene
from easyhecpp.solve import Observation

F64 = NDArray[np.float64]
Rng = np.random.Generator

ARM, OTHER_ARM = "xarm7", "panda"
_NORMAL = Degradation()


@dataclass(frozen=True)
class TrustCase:
    """What is handed to a calibration, and the truth.

    Attributes:
        rig: Robot as the calibration knows it.
        camera: Intrinsics as the calibration knows them.
        observations: The views.
        T_mount_cam: ``(4, 4)`` the truth.
        wrong: Ids of the views that do not belong.
        start_near: ``(6,)`` tangent from the truth to the start; None for no start.
    """

    rig: Rig
    camera: Camera
    observations: tuple[Observation, ...]
    T_mount_cam: F64
    wrong: frozenset[str] = field(default_factory=frozenset)
    start_near: F64 | None = None


@dataclass(frozen=True)
class StretchedRig(Rig):
    """A rig whose arm is longer beyond one link than that of the pictures.

    Attributes:
        link: From this one on, links are shifted...
        shift: ...by so many metres along its z axis.
    """

    link: int = 0
    shift: float = 0.0

    def Ts_mount_link(self, q: F64) -> F64:
        """Poses ``(..., L, 4, 4)``."""
        Ts = np.array(super().Ts_mount_link(q))
        Ts[..., self.link :, :3, 3] += self.shift * Ts[..., self.link, None, :3, 2]
        return Ts


def build_case(family: str, rng: Rng, width: int) -> TrustCase:
    """Draw a scene of a family.

    Args:
        family: A name in `FAMILIES`.
        rng: Decides everything.
        width: Of the picture, pixels.
    """
    return FAMILIES[family](rng, width)


def _scene(rng: Rng, width: int, n_views: int = 5, arm: str = ARM) -> SimScene:
    height = round(width * 9 / 16)
    return random_scene(
        load_robot(arm), rng, n_views=n_views, width=width, height=height,
        focal=900.0 / 1280.0 * width,
    )  # fmt: skip


def _case(
    scene: SimScene,
    rng: Rng,
    degradation: Degradation | None = _NORMAL,
    coverages: NDArray[np.float32] | None = None,
) -> TrustCase:
    truths = scene.coverages if coverages is None else coverages
    masks = (
        truths > 0.5 if degradation is None else degrade_masks(list(truths), rng, degradation).masks
    )
    return TrustCase(
        Rig(scene.robot),
        scene.camera,
        tuple(
            Observation(q, m, id=str(i))
            for i, (q, m) in enumerate(zip(scene.joints, masks, strict=True))
        ),
        scene.T_base_cam,
    )


def _honest(rng: Rng, width: int, *, degradation: Degradation | None, n_views: int) -> TrustCase:
    scene = _scene(rng, width)
    near = np.concatenate([rng.normal(0.0, 0.008, 3), rng.normal(0.0, 0.008, 3)])
    case = _case(scene, rng, degradation)
    return replace(case, observations=case.observations[:n_views], start_near=near)


def _good(rng: Rng, width: int) -> TrustCase:
    return _case(_scene(rng, width), rng)


def _few(rng: Rng, width: int, *, n_views: int) -> TrustCase:
    case = _good(rng, width)
    return replace(case, observations=case.observations[:n_views])


def _faulty(rng: Rng, width: int, *, fault: str) -> TrustCase:
    """One of five views is grossly wrong."""
    scene = _scene(rng, width)
    coverages = scene.coverages.copy()
    view = int(rng.integers(len(scene)))
    if fault == "missing link":
        visible = scene.visible_links(view)
        counts = np.bincount(visible[visible >= 0], minlength=len(scene.robot.link_names))
        large = np.flatnonzero(counts >= 0.1 * counts.sum())
        coverages[view] = remove_link(coverages[view], visible, int(rng.choice(large)))
    elif fault == "blob":
        coverages[view] = add_blob(coverages[view], rng, 0.15)
    elif fault == "wrong row":
        coverages[view] = coverages[(view + 1) % len(scene)]
    case = _case(scene, rng, coverages=coverages)
    if fault == "moved joints":
        views = list(case.observations)
        off = rng.choice([-1.0, 1.0], len(views[view].joints)) * rng.uniform(0.08, 0.2)
        views[view] = replace(views[view], joints=views[view].joints + off)
        case = replace(case, observations=tuple(views))
    return replace(case, wrong=frozenset({str(view)}))


def _lagging(rng: Rng, width: int) -> TrustCase:
    """A trajectory sampled while moving: joints of all views but two lag behind the picture."""
    base = _scene(rng, width, n_views=2)
    n = 8
    a, b = base.joints
    waves = rng.uniform(0.5, 1.5, len(a))

    def at(t: F64) -> F64:
        return a + (b - a) * t[:, None] + 0.15 * np.sin(2.0 * np.pi * t[:, None] * waves)

    times = np.linspace(0.0, 1.0, n)
    lags = rng.uniform(0.2, 1.7, n) / (n - 1)
    still = rng.choice(n, 2, replace=False)
    lags[still] = 0.0
    case = _case(replace(base, joints=at(times), _coverages={}), rng)
    recorded = at(times - lags)
    near = np.concatenate([rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.02, 3)])
    return replace(
        case,
        observations=tuple(
            replace(o, joints=q) for o, q in zip(case.observations, recorded, strict=True)
        ),
        wrong=frozenset(str(i) for i in range(n) if i not in still),
        start_near=near,
    )


def _alike(rng: Rng, width: int) -> TrustCase:
    scene = _scene(rng, width)
    joints = scene.joints[0] + rng.normal(0.0, 0.02, scene.joints.shape)
    return _case(replace(scene, joints=joints, _coverages={}), rng)


def _other_arm(rng: Rng, width: int) -> TrustCase:
    ours, theirs = _scene(rng, width), _scene(rng, width, arm=OTHER_ARM)
    return _case(ours, rng, coverages=theirs.coverages)


def _wrong_urdf(rng: Rng, width: int) -> TrustCase:
    case = _good(rng, width)
    link, shift = int(rng.integers(2, 6)), float(rng.choice([-1.0, 1.0]) * 0.04)
    return replace(case, rig=StretchedRig(case.rig.robot, link=link, shift=shift))


def _wrong_focal(rng: Rng, width: int, *, factor: float) -> TrustCase:
    case = _good(rng, width)
    camera = case.camera
    return replace(case, camera=replace(camera, fx=factor * camera.fx, fy=factor * camera.fy))


def _out_of_view(rng: Rng, width: int) -> TrustCase:
    scene = _scene(rng, width)
    turn = rng.uniform(0.45, 0.75) * rng.choice([-1.0, 1.0])
    axis = np.array([0.0, turn, 0.0]) if rng.random() < 0.6 else np.array([0.6 * turn, 0.0, 0.0])
    T_base_cam = scene.T_base_cam @ make_transform(exp_so3(axis), np.zeros(3))
    return _case(replace(scene, T_base_cam=T_base_cam, _coverages={}), rng)


FAMILIES: dict[str, Callable[[Rng, int], TrustCase]] = {
    **{
        f"honest, {name}": partial(_honest, degradation=degradation, n_views=n)
        for name, degradation, n in (
            ("mixed lengths", _NORMAL, 5),
            ("8 px", Degradation(correlation_px=(8.0,)), 5),
            ("20 px", Degradation(correlation_px=(20.0,)), 5),
            ("masks 0.3 px too large", Degradation(bias_px=0.3), 5),
            ("masks 0.3 px too small", Degradation(bias_px=-0.3), 5),
            ("exact", None, 5),
            ("4 views", _NORMAL, 4),
            ("3 views", _NORMAL, 3),
            ("2 views", _NORMAL, 2),
            ("1 view", _NORMAL, 1),
        )
    },
    "five good views": _good,
    **{
        f"bad view: {fault}": partial(_faulty, fault=fault)
        for fault in ("missing link", "blob", "wrong row", "moved joints")
    },
    "lagging": _lagging,
    "failing: 1 view": partial(_few, n_views=1),
    "failing: 2 views": partial(_few, n_views=2),
    "failing: views alike": _alike,
    "failing: another arm": _other_arm,
    "failing: wrong URDF": _wrong_urdf,
    "failing: focal length +5 %": partial(_wrong_focal, factor=1.05),
    "failing: focal length -5 %": partial(_wrong_focal, factor=0.95),
    "failing: mostly out of view": _out_of_view,
}
"""Scenes by name; each takes a generator and the picture's width."""
