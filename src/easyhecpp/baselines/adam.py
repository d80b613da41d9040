"""EasyHeC's optimiser: Eq. 1 of the paper by Adam, on the same renderer as ours.

The unknown is one tangent whose exponential is the whole pose from the mount to the camera; there
is no schedule, no weighting and no test of convergence. What EasyHeC does further is left out where
it does not touch the method: its weight decay is too small to matter beside a sum over pixels.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from easyhecpp._optional import require
from easyhecpp.baselines.eq1 import Combine, eq1_views
from easyhecpp.baselines.types import BaselineResult
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.geometry import exp_se3, inverse, log_se3
from easyhecpp.rig import Rig
from easyhecpp.solve import Observation

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class AdamConfig:
    """Settings; the defaults are those of EasyHeC, but for two things named here.

    Attributes:
        steps: Number of steps.
        learning_rate: For all six parameters, metres and radians alike.
        iterate: ``last`` as published, or ``best``: that with the least loss.
        combine: ``union`` of the links, exact; or ``sum``, as published: `min(1, sum)` of each
            link's silhouette, which counts twice what two links share. Eight times slower.
        half_pixel_bias: Count pixels from the picture's edge as the published code does, which
            shifts the arm by half a pixel against masks of a real camera.
    """

    steps: int = 1000
    learning_rate: float = 3e-3
    iterate: Literal["last", "best"] = "last"
    combine: Combine = "union"
    half_pixel_bias: bool = False

    def __post_init__(self) -> None:
        if self.steps < 1 or not self.learning_rate > 0.0:
            raise InputError(
                f"Adam with {self.steps} steps at a learning rate of {self.learning_rate}",
                expected="at least one step and a rate above 0",
            )
        if self.iterate not in ("last", "best"):
            raise InputError(f"Unknown iterate {self.iterate!r}", expected="last or best")


@dataclass(frozen=True)
class AdamHistory:
    """The way that Adam went.

    Attributes:
        Ts_mount_cam: ``(S + 1, 4, 4)`` the start and the pose after every step.
        losses: ``(S,)`` Eq. 1 at the pose before every step.
        seconds: ``(S + 1,)`` since the beginning of the first step.
    """

    Ts_mount_cam: F64
    losses: F64
    seconds: F64


class AdamSteps:
    """Adam on Eq. 1, step by step.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        observations: Views with masks.
        T_mount_cam_init: ``(4, 4)`` start.
        config: Settings.

    Raises:
        InputError: No view, a mask whose size is not the camera's, or a setting out of range.
        MissingExtraError: torch is not installed.
    """

    def __init__(
        self,
        rig: Rig,
        camera: Camera,
        observations: Sequence[Observation],
        T_mount_cam_init: F64,
        config: AdamConfig,
    ) -> None:
        torch = require("torch", "models", "The Adam baseline")
        from easyhecpp.baselines.torch_eq1 import eq1_loss

        if config.half_pixel_bias:
            camera = replace(camera, cx=camera.cx - 0.5, cy=camera.cy - 0.5)
        self.views = eq1_views(rig, camera, observations, config.combine)
        self._loss = eq1_loss
        self._xi = torch.tensor(log_se3(inverse(T_mount_cam_init)), requires_grad=True)
        self._adam = torch.optim.Adam([self._xi], lr=config.learning_rate)

    @property
    def tangent(self) -> F64:
        """``(6,)`` whose exponential is the present T_cam_mount."""
        return self._xi.detach().numpy().copy()

    def step(self) -> float:
        """Take a step; returns the loss before it."""
        self._adam.zero_grad()
        loss = self._loss(self._xi, self.views)
        loss.backward()
        self._adam.step()
        return loss.item()


def calibrate_with_adam(
    rig: Rig,
    camera: Camera,
    observations: Sequence[Observation],
    T_mount_cam_init: F64,
    config: AdamConfig | None = None,
) -> tuple[BaselineResult, AdamHistory]:
    """Minimise Eq. 1 from a start.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        observations: Views with masks.
        T_mount_cam_init: ``(4, 4)`` start.
        config: Settings.

    Returns:
        The pose, and every pose on the way to it.

    Raises:
        InputError: No view, a mask whose size is not the camera's, or a setting out of range.
        MissingExtraError: torch is not installed.
    """
    config = config or AdamConfig()
    adam = AdamSteps(rig, camera, observations, T_mount_cam_init, config)
    tangents = np.empty((config.steps + 1, 6))
    losses, seconds = np.empty(config.steps), np.zeros(config.steps + 1)
    tangents[0] = adam.tangent
    clock = time.perf_counter()
    for step in range(config.steps):
        losses[step] = adam.step()
        tangents[step + 1] = adam.tangent
        seconds[step + 1] = time.perf_counter() - clock
    history = AdamHistory(inverse(exp_se3(tangents)), losses, seconds)
    chosen = config.steps if config.iterate == "last" else int(losses.argmin())
    result = BaselineResult(
        T_mount_cam=history.Ts_mount_cam[chosen],
        method=f"Adam, {config.iterate} of {config.steps} steps",
        seconds=float(seconds[-1]),
        views_used=len(observations),
        status="done",
        message=f"Eq. 1 went from {losses[0]:.0f} to {losses[-1]:.0f}; no test of convergence.",
    )
    return result, history
