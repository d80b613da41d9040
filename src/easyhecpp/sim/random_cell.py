"""Drawing a plausible random cell: where the camera is, what the room and the arms look like."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from easyhecpp.errors import NothingSuitsError
from easyhecpp.rig import Rig, rides_on_arm
from easyhecpp.robot import Robot
from easyhecpp.sim.arm_surface import ArmSurface
from easyhecpp.sim.cell import Cell
from easyhecpp.sim.distractor import Distractor, alike, random_distractor
from easyhecpp.sim.finishes import ArmLook, random_look
from easyhecpp.sim.options import CellOptions
from easyhecpp.sim.placement import front_azimuth, random_camera, tripod_camera, wrist_camera
from easyhecpp.sim.robots import is_robot_file, load_robot, named_robot, robot_names
from easyhecpp.sim.room import RoomPlan, random_surroundings
from easyhecpp.sim.sensor import random_sensor

F64 = NDArray[np.float64]


_DRAWS = 20


def cell_with_poses(
    robot: Robot | str, rng: np.random.Generator, options: CellOptions, count: int
) -> tuple[Cell, F64]:
    """A cell and joint poses ``(count, n)`` of the arm in it.

    Things may stand wherever the camera sees the arm: such a cell is drawn again.

    Raises:
        NothingSuitsError: Twenty cells in turn had too few poses.
    """
    for _ in range(_DRAWS - 1):
        cell = random_cell(robot, rng, options)
        with suppress(NothingSuitsError):
            return cell, cell.random_joints(count, rng)
    cell = random_cell(robot, rng, options)
    return cell, cell.random_joints(count, rng)


def random_cell(robot: Robot | str, rng: np.random.Generator, options: CellOptions) -> Cell:
    """Draw a cell; see `easyhecpp.sim.cell.Cell.random`."""
    model, on_floor, ee_link = _resolve(robot, options)
    rig = Rig(model, options.setup, ee_link)
    stand_z = stand_height(model, on_floor=on_floor)
    camera = random_camera(rng, options.width, options.height, options.distortion)
    T_mount_cam = _camera_pose(rng, rig, stand_z, options)
    plan = _room_plan(rng, rig, stand_z, on_floor, T_mount_cam, options)
    look = random_look(rng, model.reach)
    surroundings = random_surroundings(rng, plan)
    distractor = None
    if rng.random() < options.distractor:
        distractor = _second_arm(rng, model, look, plan, options)
    return Cell(
        rig,
        camera,
        T_mount_cam,
        look,
        surroundings,
        random_sensor(rng, noise=options.noise, flicker=options.flicker),
        stand_z,
        int(rng.integers(2**31)),
        distractor,
        options.least_visible,
    )


def _resolve(robot: Robot | str, options: CellOptions) -> tuple[Robot, bool, str | None]:
    """The robot, whether it stands on the floor, and the link a wrist camera rides on."""
    if isinstance(robot, str) and is_robot_file(robot):
        robot = load_robot(robot)
    if isinstance(robot, str):
        entry = named_robot(robot)
        return load_robot(robot), entry.stands_on == "floor", options.ee_link or entry.ee_link
    lowest = float(ArmSurface.of(robot).in_base(robot.neutral)[:, 2].min())
    return robot, lowest < -0.5, options.ee_link


def stand_height(robot: Robot, *, on_floor: bool = False) -> float:
    """Height of the base's underside: of the first link, or of all links on a stand."""
    poses = robot.link_poses(robot.neutral)
    lowest = [
        float((mesh.vertices @ T[2, :3] + T[2, 3]).min())
        for mesh, T in zip(robot.meshes, poses, strict=True)
    ]
    return min(lowest) if on_floor else lowest[0]


def _camera_pose(rng: np.random.Generator, rig: Rig, stand_z: float, options: CellOptions) -> F64:
    if rides_on_arm(rig.setup):
        return wrist_camera(rng, rig.robot, rig.mount)
    return tripod_camera(
        rng,
        rig.robot,
        stand_z,
        azimuth_deg=options.azimuth_deg,
        elevation_deg=options.elevation_deg,
        roll_deg=options.roll_deg,
        distance=options.distance,
    )


def _room_plan(
    rng: np.random.Generator,
    rig: Rig,
    stand_z: float,
    on_floor: bool,
    T_mount_cam: F64,
    options: CellOptions,
) -> RoomPlan:
    """A room whose back wall is opposite the camera, or behind the arm for one on the wrist."""
    azimuth, away, z = front_azimuth(rig.robot), 0.0, stand_z
    if not rides_on_arm(rig.setup):
        x, y, z = T_mount_cam[:3, 3]
        azimuth, away = float(np.arctan2(y, x)), float(np.hypot(x, y))
    return RoomPlan(
        rig.robot.reach,
        stand_z,
        on_floor,
        azimuth,
        away,
        float(z),
        n_clutter=int(rng.integers(options.clutter[0], options.clutter[1] + 1)),
        n_furniture=options.furniture,
        n_pictures=options.pictures,
        foreground=bool(rng.random() < options.foreground),
    )


def _second_arm(
    rng: np.random.Generator, robot: Robot, look: ArmLook, plan: RoomPlan, options: CellOptions
) -> Distractor:
    """Another arm like the first one, or any that stands on a table."""
    names = [n for n in robot_names() if named_robot(n).stands_on == "table"]
    same = rng.random() < options.same_arm
    other = robot if same else load_robot(str(rng.choice(names)))
    second = random_distractor(
        rng,
        robot,
        other,
        stand_z=plan.stand_z,
        floor_z=plan.floor_z,
        camera_azimuth=plan.camera_azimuth,
        moves=bool(rng.random() < options.distractor_moves),
    )
    return alike(second, look) if same else second
