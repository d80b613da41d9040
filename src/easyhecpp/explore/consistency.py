"""The paper's score of a joint pose: how much masks differ between poses the camera may have.

EasyHeC renders a hard mask for every camera hypothesis and sums the unbiased variance over all
pixels. That sum is an integral over the picture, and is taken here along a few dozen lines, exactly
in x (see `_spread_kernel`). So hypotheses that differ by a fraction of a pixel still count, and the
score does not depend on the size of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from easyhecpp._parallel import parallel_map, usable_cores
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.explore._spread_kernel import summed_variances
from easyhecpp.geometry import inverse
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.render._raster_kernel import LINES
from easyhecpp.rig import Rig

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class ConsistencyConfig:
    """Counts and fineness of the paper's score.

    Attributes:
        joint_poses: Joint poses to score.
        hypotheses: Poses that the camera may have.
        lines: Lines across the picture along which masks are compared, about.
        simplified: Error of the simplified meshes as a share of the reach.
    """

    joint_poses: int = 2000
    hypotheses: int = 50
    lines: int = 96
    simplified: float = 0.012

    def __post_init__(self) -> None:
        if self.joint_poses < 1 or self.hypotheses < 2 or self.lines < 1:
            raise InputError(
                f"{self.joint_poses} joint poses under {self.hypotheses} hypotheses along "
                f"{self.lines} lines cannot be scored",
                expected="at least one joint pose, two hypotheses and one line",
            )


EASYHEC = ConsistencyConfig(joint_poses=1000, hypotheses=10)
"""The counts in EasyHeC's code; `ConsistencyConfig()` has those of its paper."""


def consistency_scores(
    rig: Rig,
    camera: Camera,
    Ts_mount_cam: F64,
    joints: F64,
    config: ConsistencyConfig | None = None,
) -> F64:
    """Sum over the picture of the variance of hard masks over camera hypotheses.

    Args:
        rig: Robot and set-up.
        camera: Intrinsics.
        Ts_mount_cam: ``(H, 4, 4)`` hypotheses; at least two.
        joints: ``(N, n)``.
        config: Fineness; the counts are those of the arrays.

    Returns:
        ``(N,)`` in pixels of the camera; zero where the arm is out of view.

    Raises:
        InputError: Fewer than two hypotheses.
    """
    config = config or ConsistencyConfig()
    if len(Ts_mount_cam) < 2:
        raise InputError(
            f"{len(Ts_mount_cam)} pose of the camera has no variance",
            where="Ts_mount_cam",
            expected="at least two hypotheses",
        )
    robot = rig.robot.simplified(config.simplified * rig.robot.reach)
    reduction = max(1.0, camera.height * LINES / config.lines)
    renderer = SilhouetteRenderer(robot.meshes, camera.scaled(1.0 / reduction))
    Ts_mount_link = np.ascontiguousarray(Rig(robot, rig.setup, rig.ee_link).Ts_mount_link(joints))
    Ts_cam_mount = np.ascontiguousarray(inverse(Ts_mount_cam))
    small, p = renderer.camera, renderer.packed
    fc, model, k, valid_radius = small.numba_params()

    def score(chunk: F64) -> F64:
        return summed_variances(
            Ts_cam_mount, chunk, small.width, small.height, p.vertices, p.vertex_start, p.boxes,
            p.planes, p.faces, p.face_start, p.edges, p.edge_faces, p.edge_start,
            fc, model, k, valid_radius,
        )  # fmt: skip

    chunks = np.array_split(Ts_mount_link, min(len(Ts_mount_link), 4 * usable_cores()))
    pixels = (camera.width / small.width) * (camera.height / small.height)
    return pixels * np.concatenate(parallel_map(score, chunks))
