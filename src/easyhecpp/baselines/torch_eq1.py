"""Eq. 1 as a torch operation. Import it only where torch is known to be there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from easyhecpp._parallel import parallel_map
from easyhecpp.baselines.eq1 import Eq1View
from easyhecpp.geometry import hat, inverse


def eq1_loss(xi: torch.Tensor, views: Sequence[Eq1View]) -> torch.Tensor:
    """Eq. 1: the mean over the views; differentiable.

    Args:
        xi: ``(6,)`` float64 ``[rho, omega]``, metres and radians; its exponential is T_cam_mount.
        views: What is compared with.
    """
    return _SquaredDifferences.apply(pose_from_tangent(xi), views).mean()


def pose_from_tangent(xi: torch.Tensor) -> torch.Tensor:
    """The exponential ``(4, 4)`` of a tangent ``(6,)``, ``[rho, omega]``."""
    zero = xi.new_zeros(())
    v, w = xi[:3], xi[3:]
    rows = [
        torch.stack([zero, -w[2], w[1], v[0]]),
        torch.stack([w[2], zero, -w[0], v[1]]),
        torch.stack([-w[1], w[0], zero, v[2]]),
        xi.new_zeros(4),
    ]
    return torch.linalg.matrix_exp(torch.stack(rows))


class _SquaredDifferences(torch.autograd.Function):
    """Sums of squares ``(V,)`` of all views, from T_cam_mount ``(4, 4)``."""

    @staticmethod
    def forward(ctx: Any, T_cam_mount: torch.Tensor, views: Sequence[Eq1View]) -> torch.Tensor:
        T = T_cam_mount.detach().numpy()
        compared = parallel_map(lambda view: view(T), views)
        ctx.T_cam_mount = T
        ctx.derivatives = np.stack([derivative for _, derivative in compared])
        return torch.tensor([loss for loss, _ in compared], dtype=T_cam_mount.dtype)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, None]:
        by_delta = gradients[0].numpy() @ ctx.derivatives
        # Autograd wants it by the matrix. Only its product with motions that a rigid body can make
        # matters, `hat(delta) @ T`; this one gives `by_delta @ delta` for all of them.
        twist = np.zeros((4, 4))
        twist[:3, :3] = 0.5 * hat(by_delta[3:])
        twist[:3, 3] = by_delta[:3]
        return torch.from_numpy(twist @ inverse(ctx.T_cam_mount).T), None
