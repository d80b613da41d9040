"""From a table of columns to joint vectors in the robot's order.

What the robot needs and what the table holds rarely agree exactly: a driver logs extra columns, a
gripper's fingers are not logged at all, angles come in degrees. What is certain is done and noted;
what would put the arm somewhere else without anybody noticing is an error.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from easyhecpp.capture._text import closest, did_you_mean, listing, plural
from easyhecpp.capture.config import CONFIG_NAME, CaptureConfig
from easyhecpp.capture.joint_table import JointTable
from easyhecpp.capture.problems import Findings
from easyhecpp.robot import Robot

# Beyond a turn by this much, and beyond the joint's own limits, an angle is no angle in radians.
_MAX_ANGLE = 2 * np.pi + 0.5
# Joints without limits may have been wound up by a few turns.
_MAX_WOUND_ANGLE = 6 * np.pi
_LIMIT_TOLERANCE = 0.02
_LIMIT_TOLERANCE_PRISMATIC = 0.002
_FINGER_WORDS = ("finger", "gripper", "knuckle", "jaw", "thumb", "hand", "claw", "drive")
_PROBE_STEP = 0.1


def moved_frames(robot: Robot, carrier: str | None = None) -> NDArray[np.bool_]:
    """Which frames each joint moves, found by moving it a little.

    Args:
        robot: The arm.
        carrier: The link that carries the camera, if one does.

    Returns:
        (n, F): the links with geometry, and ``carrier`` as the last one when it is given.
    """
    q = np.concatenate([robot.neutral[None], robot.neutral + _PROBE_STEP * np.eye(robot.n_joints)])
    poses = robot.link_poses(q)
    if carrier is not None:
        poses = np.concatenate([poses, robot.frame_pose(q, carrier)[:, None]], axis=1)
    return np.abs(poses[1:] - poses[:1]).max(axis=(2, 3)) > 1e-9


class JointReader:
    """Turns the rows of one table into joint vectors of one robot.

    Args:
        table: What `joints.csv` holds.
        robot: Whose joints these are.
        config: Units and default positions.
        findings: Receives what is wrong or had to be assumed.
    """

    def __init__(
        self, table: JointTable, robot: Robot, config: CaptureConfig, findings: Findings
    ) -> None:
        self._table = table
        self._robot = robot
        self._config = config
        self._findings = findings
        self._names = list(robot.joint_names)
        self._in_degrees = config.joint_units == "deg"

    def vectors(self) -> dict[str, NDArray[np.float64]]:
        """Joint positions (n,) by view, in the robot's order, radians and metres.

        Empty when the columns do not fit the robot; views with bad cells are left out.
        """
        if not self._check_columns():
            return {}
        bad = self._check_cells()
        base = self._defaults()
        vectors: dict[str, NDArray[np.float64]] = {}
        for view, row in self._table.rows.items():
            if view in bad:
                continue
            q = base.copy()
            for name, value in zip(self._table.columns, row, strict=True):
                if name in self._names:
                    index = self._names.index(name)
                    q[index] = value * self._factor(index)
            vectors[view] = q
        if vectors and self._check_units(bad):
            self._check_limits(vectors)
        return vectors

    @cached_property
    def _moves(self) -> NDArray[np.bool_]:
        carrier = self._config.ee_link
        return moved_frames(self._robot, carrier if carrier in self._robot.frame_names else None)

    @cached_property
    def _measured(self) -> list[str]:
        return [name for name in self._names if name in self._table.columns]

    @cached_property
    def _missing(self) -> list[str]:
        """Joints that have neither a column nor a default, and that make a difference."""
        return [
            name
            for index, name in enumerate(self._names)
            if name not in self._table.columns
            and name not in self._config.default_joints
            and self._moves[index].any()
        ]

    @cached_property
    def _extra(self) -> list[str]:
        return [name for name in self._table.columns if name not in self._names]

    def _factor(self, index: int) -> float:
        return np.pi / 180 if self._in_degrees and self._type(index) != "prismatic" else 1.0

    def _type(self, index: int) -> str:
        return self._robot.joint_types[index]

    def _carries(self, index: int, other: int) -> bool:
        """Whether one joint stands between the base and another."""
        behind = self._moves[other]
        return bool(behind.any() and (self._moves[index] | ~behind).all())

    def _check_columns(self) -> bool:
        """Whether the columns determine where the arm is."""
        where = str(self._table.path)
        known = listing(self._names, limit=20)
        for name in self._config.default_joints:
            if name not in self._names:
                self._findings.error(
                    f"'default_joints' in {CONFIG_NAME} names '{name}', which is no joint of the "
                    f"robot '{self._robot.name}'",
                    where=CONFIG_NAME,
                    expected=f"joints out of {known}",
                    fix=did_you_mean(name, self._names) or "Remove it",
                )
        needed = [name for name in self._missing if self._is_needed(name)]
        if needed or (self._names and not self._measured):
            self._findings.error(
                f"The table of joints has no column for {listing(needed or self._missing)}; "
                f"columns that are no joint of the robot: {listing(self._extra)}",
                where=where,
                expected=f"the robot's joint names: {known}",
                fix=self._rename_hint(needed or self._missing)
                or f"Add the columns, or the positions to 'default_joints' in {CONFIG_NAME}",
            )
            return False
        if self._extra:
            self._findings.note(
                f"Columns that are no joint of the robot are not used: {listing(self._extra)}",
                where=where,
            )
        return True

    def _is_needed(self, name: str) -> bool:
        """Whether a joint without a column is one of the arm's own, not a finger.

        It is when a measured joint hangs behind it, when it belongs to the same numbered series as
        a measured one, or when a column looks like a misspelling of it.
        """
        index = self._names.index(name)
        measured = [self._names.index(other) for other in self._measured]
        series = {_series(other) for other in self._measured}
        return (
            any(self._carries(index, other) for other in measured)
            or (_series(name) in series and not _is_finger(name))
            or closest(name, self._extra, cutoff=0.8) is not None
        )

    def _rename_hint(self, missing: Sequence[str]) -> str | None:
        pairs = [(near, name) for name in missing if (near := closest(name, self._extra))]
        if not pairs:
            return None
        return "Rename " + listing((f"'{near}' to '{name}'" for near, name in pairs), limit=3)

    def _check_cells(self) -> set[str]:
        """The views with a cell that is no finite number."""
        bad = set()
        for view, line, column, text in self._table.texts:
            if column not in self._names:
                continue
            bad.add(view)
            self._findings.error(
                f"'{text}' in column '{column}', view '{view}', is not a finite number"
                if text
                else f"The cell in column '{column}', view '{view}', is empty",
                where=f"{self._table.path}, line {line}",
                expected="a position in radians (or metres), with a decimal point",
                fix="Enter the joint's position, or delete the view",
                views=(view,),
                drops="view",
            )
        return bad

    def _defaults(self) -> NDArray[np.float64]:
        """A vector with the positions of all joints that have no column."""
        q = self._robot.neutral.copy()
        for name, value in self._config.default_joints.items():
            if name in self._measured:
                self._findings.note(
                    f"'{name}' has a column, so its entry in 'default_joints' is not used",
                    where=CONFIG_NAME,
                )
            elif name in self._names:
                index = self._names.index(name)
                q[index] = value * self._factor(index)
        fingers = [name for name in self._missing if _is_finger(name)]
        others = [name for name in self._missing if not _is_finger(name)]
        fix = f"Give their positions under 'default_joints' in {CONFIG_NAME} if you know them"
        if fingers:
            self._findings.note(
                f"No column for {listing(fingers)}: held at the middle of the range", fix=fix
            )
        if others:
            self._findings.warn(
                f"No column for {listing(others)}, which move parts of the robot: held at the "
                "middle of the range",
                where=str(self._table.path),
                fix=f"{fix}, or leave their links out with 'ignore_links'",
            )
        return q

    def _check_units(self, bad: set[str]) -> bool:
        """Whether the numbers can have the unit they are said to have."""
        views = [view for view in self._table.rows if view not in bad]
        turning = [
            name for name in self._measured if self._type(self._names.index(name)) != "prismatic"
        ]
        if not turning:
            return True
        values = np.array(
            [
                [self._table.rows[view][self._table.columns.index(name)] for name in turning]
                for view in views
            ]
        )
        if self._in_degrees:
            if np.abs(values).max() <= _MAX_ANGLE and np.ptp(values) > 0:
                self._findings.warn(
                    f"No joint position is above {np.abs(values).max():.3g}, which looks like "
                    "radians, but joint_units is deg",
                    where=str(self._table.path),
                    fix=f"Remove 'joint_units: deg' from {CONFIG_NAME} if they are radians",
                )
            return True
        beyond = np.abs(values) > np.array([self._largest_angle(name) for name in turning])
        if not beyond.any():
            return True
        row, column = np.argwhere(beyond)[0]
        self._findings.error(
            f"Joint '{turning[column]}' is {values[row, column]:g} in view '{views[row]}' "
            f"({plural(int(beyond.sum()), 'such value')}): more than a turn beyond any radians "
            "this joint can have, so these are degrees",
            where=str(self._table.path),
            expected="radians",
            fix=f"Add 'joint_units: deg' to {CONFIG_NAME}, or convert the table",
        )
        return False

    def _largest_angle(self, name: str) -> float:
        index = self._names.index(name)
        if self._type(index) == "continuous":
            return _MAX_WOUND_ANGLE
        lower, upper = self._robot.lower[index], self._robot.upper[index]
        return max(_MAX_ANGLE, abs(lower) + 0.5, abs(upper) + 0.5)

    def _check_limits(self, vectors: dict[str, NDArray[np.float64]]) -> None:
        """Warn of joints beyond their limits; encoders and URDFs disagree a little in real life."""
        views = list(vectors)
        q = np.array([vectors[view] for view in views])
        tolerance = np.where(
            np.array(self._robot.joint_types) == "prismatic",
            _LIMIT_TOLERANCE_PRISMATIC,
            _LIMIT_TOLERANCE,
        )
        beyond = (q < self._robot.lower - tolerance) | (q > self._robot.upper + tolerance)
        for name in self._measured:
            index = self._names.index(name)
            lower, upper = self._robot.lower[index], self._robot.upper[index]
            if self._type(index) == "continuous" or not beyond[:, index].any():
                continue
            rows = np.flatnonzero(beyond[:, index])
            worst = q[rows[np.abs(q[rows, index] - (lower + upper) / 2).argmax()], index]
            self._findings.warn(
                f"Joint '{name}' reaches {worst:.4g}, beyond its limits of {lower:.4g} to "
                f"{upper:.4g}, in view {listing(views[row] for row in rows)}",
                where=str(self._table.path),
                fix="Check the column's sign and unit, and that the URDF is this robot's",
                views=tuple(views[row] for row in rows),
            )


def _series(name: str) -> str:
    """The name without its digits: the same for `joint1` and `joint7`."""
    return re.sub(r"\d+", "#", name)


def _is_finger(name: str) -> bool:
    return any(word in name.lower() for word in _FINGER_WORDS)
