"""A board on a simulated arm, and the joint poses in which a camera sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from easyhecpp.baselines.board_views import Flaws, render_board_view
from easyhecpp.baselines.boards import Board, board_pose
from easyhecpp.camera import Camera
from easyhecpp.geometry import inverse, make_transform, transform_points
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.robot import Robot
from easyhecpp.robot.robot import check_links
from easyhecpp.sim.arm_surface import ArmSurface

F64 = NDArray[np.float64]

GAP = 0.02
"""Metres between the arm and the board."""

MAX_SLANT = np.deg2rad(50.0)
"""Who chooses poses by hand does not show the board more from the side than this."""

MAX_HIDDEN = 0.02
"""Nor does he take a pose in which the arm hides more of the board."""

_BATCH, _MOST_DRAWS = 500, 60_000


@dataclass(frozen=True)
class BoardShots:
    """Joint poses in which a board was seen and found.

    Attributes:
        joints: ``(N, n)``.
        Ts_cam_board: ``(N, 4, 4)`` as found in the pictures.
        Ts_cam_board_true: ``(N, 4, 4)`` as they are.
        in_view: Share of random joint poses that turn the whole board to the camera.
        pictures: Number of pictures taken; the board was not found in the others.
    """

    joints: F64
    Ts_cam_board: F64
    Ts_cam_board_true: F64
    in_view: float
    pictures: int

    def __len__(self) -> int:
        return len(self.joints)


@dataclass(frozen=True, eq=False)
class BoardOnArm:
    """A board screwed to a link of an arm that a fixed camera looks at.

    Attributes:
        robot: The arm.
        link: The board's holder. The print faces along the link's z axis, just beyond all that
            moves with the link.
        board: The board.
        camera: Intrinsics.
        T_base_cam: ``(4, 4)`` true pose of the camera.

    Raises:
        InputError: The robot has no such link.
    """

    robot: Robot
    link: str
    board: Board
    camera: Camera
    T_base_cam: F64

    def __post_init__(self) -> None:
        check_links([self.link], self.robot.frame_names, "the link that holds the board")

    @cached_property
    def T_link_board(self) -> F64:
        """``(4, 4)`` where the board is; unknown to a calibration."""
        b = self.board
        R = np.diag([1.0, -1.0, -1.0])
        corner = R @ (b.square * np.array([b.columns, b.rows, 0.0]) / 2.0)
        return make_transform(R, np.array([0.0, 0.0, self._top() + GAP]) - corner)

    def take_pictures(
        self,
        count: int,
        rng: np.random.Generator,
        *,
        is_free: Callable[[F64], NDArray[np.bool_]] | None = None,
        flaws: Flaws | None = None,
    ) -> BoardShots:
        """Find joint poses that show the board, take a picture of each and look for the board.

        Joints are drawn evenly within their limits and kept when the whole board is in the
        picture, slanted by less than `MAX_SLANT`, hidden by no more than `MAX_HIDDEN`, and the arm
        touches neither itself nor the camera. Where the board is not found, another pose is tried.

        Args:
            count: Number of pictures with the board wanted; fewer come back where the board is
                hardly ever in view.
            rng: Decides everything.
            is_free: Which joint poses ``(N, n)`` the surroundings allow, ``(N,)``.
            flaws: Of the board and the camera.
        """
        renderer = SilhouetteRenderer(self.robot.meshes, self.camera)
        surface = ArmSurface.of(self.robot)
        good: list[F64] = []
        found: list[F64] = []
        drawn = seen = pictures = 0
        while len(good) < count and drawn < _MOST_DRAWS:
            poses = surface.draw_poses(_BATCH, rng)
            Ts_cam_board = self._Ts_cam_board(poses)
            shown = self._shows(Ts_cam_board)
            drawn, seen = drawn + len(poses), seen + int(shown.sum())
            if is_free is not None:
                shown &= is_free(poses)
            for q, T in zip(poses[shown], Ts_cam_board[shown], strict=True):
                if len(good) == count or not self._is_possible(surface, q):
                    continue
                Ts_base_link = self.robot.link_poses(q)
                view = render_board_view(
                    self.board, self.camera, T, rng,
                    arm=(renderer, inverse(self.T_base_cam) @ Ts_base_link), flaws=flaws,
                )  # fmt: skip
                if view.hidden > MAX_HIDDEN:
                    continue
                pictures += 1
                corners = self.board.detect(view.picture)
                pose = None if corners is None else board_pose(self.board, self.camera, corners)
                if pose is not None:
                    good.append(q)
                    found.append(pose)
        joints = np.array(good).reshape(-1, self.robot.n_joints)
        return BoardShots(
            joints,
            np.array(found).reshape(-1, 4, 4),
            self._Ts_cam_board(joints),
            seen / drawn,
            pictures,
        )

    def _Ts_cam_board(self, joints: F64) -> F64:
        """``(N, 4, 4)`` where the camera has the board."""
        Ts_base_link = self.robot.frame_pose(joints, self.link)
        return inverse(self.T_base_cam) @ Ts_base_link @ self.T_link_board

    def _is_possible(self, surface: ArmSurface, q: F64) -> bool:
        """Whether the arm touches neither the camera nor itself."""
        clear = surface.nearest(self.T_base_cam, q[None])[0] > 0.1 * self.robot.reach
        return bool(clear) and not surface.collides(q)

    def _shows(self, Ts_cam_board: F64) -> NDArray[np.bool_]:
        """``(N,)`` whether the whole board, margin and all, faces the camera and is in view."""
        b = self.board
        x, y = (-1.0, b.columns + 1.0), (-1.0, b.rows + 1.0)
        sheet = b.square * np.array([[i, j, 0.0] for i in x for j in y])
        px = self.camera.project(transform_points(Ts_cam_board, sheet))
        size = np.array([self.camera.width, self.camera.height])
        with np.errstate(invalid="ignore"):  # behind the camera: not a number
            inside = ((px > 0.0) & (px < size - 1.0)).all(axis=(-1, -2))
        middle = b.square * np.array([b.columns, b.rows, 0.0]) / 2.0
        sight = transform_points(Ts_cam_board, middle)
        along = np.einsum("ni,ni->n", sight, Ts_cam_board[:, :3, 2])
        return inside & (along > np.cos(MAX_SLANT) * np.linalg.norm(sight, axis=-1))

    def _top(self) -> float:
        """How far along the link's z axis anything reaches that moves with it, metres."""
        robot = self.robot
        holder = robot.frame_names.index(self.link)
        T_link_base = inverse(robot.frame_pose(robot.neutral, self.link))
        Ts_link = T_link_base @ robot.link_poses(robot.neutral)
        tops = [0.0]
        for name, mesh, T in zip(robot.link_names, robot.meshes, Ts_link, strict=True):
            frame = robot.frame_names.index(name)
            while frame not in (holder, -1):
                frame = int(robot.tree.frames_above[frame])
            if frame == holder:
                tops.append(float(transform_points(T, mesh.vertices)[:, 2].max()))
        return max(tops)
