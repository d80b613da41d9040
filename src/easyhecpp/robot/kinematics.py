"""Batched forward kinematics of a URDF tree.

Everything fixed is folded away once: each frame becomes a moving joint and a constant offset, so
that a call only multiplies along the moving joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from easyhecpp.errors import InputError
from easyhecpp.robot.urdf import Urdf, UrdfJoint


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """The moving joints of a robot and where every frame hangs.

    A moving joint's value is `multipliers * q[sources] + offsets`; for a joint with a motor of
    its own that is q itself, for a mimic joint the whole chain of mimicking is folded in.
    M moving joints, F frames, in an order where parents come first.

    Attributes:
        joint_names: names of the n actuated joints, in document order.
        frame_names: the F link names.
        sources: (M,) index into q.
        multipliers: (M,).
        offsets: (M,) radians or metres.
        is_prismatic: (M,) bool.
        axes: (M, 3) unit axes in the joint frame.
        parents: (M,) index of the previous moving joint, -1 for the root.
        Ts_parent_joint: (M, 4, 4) constant pose in the previous moving joint's frame.
        frame_parents: (F,) index of the moving joint a frame rides on, -1 for the root.
        Ts_parent_frame: (F, 4, 4) constant pose of a frame on that joint.
        frames_above: (F,) index of the next link towards the root, -1 for the root itself.
    """

    joint_names: tuple[str, ...]
    frame_names: tuple[str, ...]
    sources: np.ndarray
    multipliers: np.ndarray
    offsets: np.ndarray
    is_prismatic: np.ndarray
    axes: np.ndarray
    parents: np.ndarray
    Ts_parent_joint: np.ndarray
    frame_parents: np.ndarray
    Ts_parent_frame: np.ndarray
    frames_above: np.ndarray

    def moving_poses(self, q: np.ndarray) -> np.ndarray:
        """Poses of the moving joints' child frames in the root, and last the root itself.

        Args:
            q: (N, n) joint values, radians or metres.

        Returns:
            (N, M+1, 4, 4); the last entry is the identity, so that index -1 is the root.
        """
        count = len(self.sources)
        values = self.multipliers * q[:, self.sources] + self.offsets
        motions = self._Ts_parent_joint_moved(values)
        poses = np.empty((len(q), count + 1, 4, 4))
        poses[:, count] = np.eye(4)
        for m in range(count):
            np.matmul(poses[:, self.parents[m]], motions[:, m], out=poses[:, m])
        return poses

    def frame_poses(self, q: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """(N, len(frames), 4, 4) poses in the root of the frames with the given indices."""
        return self.moving_poses(q)[:, self.frame_parents[frames]] @ self.Ts_parent_frame[frames]

    def _Ts_parent_joint_moved(self, values: np.ndarray) -> np.ndarray:
        """(N, M, 4, 4): the constant pose times the joint's own turn or slide."""
        angle = np.where(self.is_prismatic, 0.0, values)[..., None, None]
        slide = np.where(self.is_prismatic, values, 0.0)[..., None]
        K = np.zeros((len(self.axes), 3, 3))
        x, y, z = self.axes.T
        K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -z, y, -x
        K -= K.transpose(0, 2, 1)
        turn = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
        moved = np.empty((*values.shape, 4, 4))
        R = self.Ts_parent_joint[:, :3, :3]
        moved[..., :3, :3] = R @ turn
        moved[..., :3, 3] = self.Ts_parent_joint[:, :3, 3] + slide * np.einsum(
            "mij,mj->mi", R, self.axes
        )
        moved[..., 3, :] = (0.0, 0.0, 0.0, 1.0)
        return moved


def build_tree(urdf: Urdf, path: Path) -> KinematicTree:
    """Fold the fixed joints and the mimic rules of a URDF into a `KinematicTree`.

    `path` is only used in error texts.

    Raises:
        InputError: a mimic rule names an unknown or fixed joint, or goes in a circle.
    """
    actuated = [j for j in urdf.joints if j.moves and j.mimic is None]
    moving = [j for j in _parents_first(urdf) if j.moves]
    rules = [_mimic_rule(j, urdf, path) for j in moving]
    index_of = {j.name: i for i, j in enumerate(actuated)}
    moving_index = {j.child: m for m, j in enumerate(moving)}

    # Walk the tree once, carrying for each link the moving joint it rides on and its offset.
    rides = {urdf.root: (-1, np.eye(4))}
    parents, Ts_parent_joint = [], []
    for joint in _parents_first(urdf):
        parent, T_ride_parent = rides[joint.parent]
        T_ride_joint = T_ride_parent @ joint.T_parent_joint
        if joint.moves:
            parents.append(parent)
            Ts_parent_joint.append(T_ride_joint)
            rides[joint.child] = (moving_index[joint.child], np.eye(4))
        else:
            rides[joint.child] = (parent, T_ride_joint)

    frames = tuple(urdf.links)
    above = {joint.child: joint.parent for joint in urdf.joints}
    return KinematicTree(
        joint_names=tuple(j.name for j in actuated),
        frame_names=frames,
        sources=_frozen([index_of[source] for source, _, _ in rules], np.intp),
        multipliers=_frozen([k for _, k, _ in rules]),
        offsets=_frozen([b for _, _, b in rules]),
        is_prismatic=_frozen([j.type == "prismatic" for j in moving], bool),
        axes=_frozen([j.axis for j in moving], shape=(-1, 3)),
        parents=_frozen(parents, np.intp),
        Ts_parent_joint=_frozen(Ts_parent_joint, shape=(-1, 4, 4)),
        frame_parents=_frozen([rides[f][0] for f in frames], np.intp),
        Ts_parent_frame=_frozen([rides[f][1] for f in frames]),
        frames_above=_frozen([frames.index(above[f]) if f in above else -1 for f in frames], int),
    )


def _parents_first(urdf: Urdf) -> list[UrdfJoint]:
    """All joints, each after the joint above it; siblings in document order."""
    below: dict[str, list[UrdfJoint]] = {}
    for joint in urdf.joints:
        below.setdefault(joint.parent, []).append(joint)
    ordered: list[UrdfJoint] = []
    stack = below.get(urdf.root, [])[::-1]
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack.extend(below.get(joint.child, [])[::-1])
    return ordered


def _mimic_rule(joint: UrdfJoint, urdf: Urdf, path: Path) -> tuple[str, float, float]:
    """The actuated joint that drives a joint, and `value = k * q + b`, chains folded."""
    by_name = {j.name: j for j in urdf.joints}
    k, b, seen = 1.0, 0.0, [joint.name]
    while (mimic := by_name[seen[-1]].mimic) is not None:
        source = by_name.get(mimic.joint)
        if source is None or not source.moves:
            what = "does not exist" if source is None else "is fixed"
            raise InputError(
                f"Joint '{seen[-1]}' mimics the joint '{mimic.joint}', which {what}",
                where=path,
                expected=f"one of {', '.join(j.name for j in urdf.joints if j.moves)}",
            )
        if mimic.joint in seen:
            raise InputError(
                f"The joints {' -> '.join([*seen, mimic.joint])} mimic each other in a circle",
                where=path,
                expected="a mimic chain that ends at a joint without <mimic>",
            )
        k, b = k * mimic.multiplier, b + k * mimic.offset
        seen.append(mimic.joint)
    return seen[-1], k, b


def _frozen(
    values: Sequence[Any], dtype: type = np.float64, shape: tuple[int, ...] = (-1,)
) -> np.ndarray:
    array = np.array(values, dtype=dtype)
    if shape != (-1,):
        array = array.reshape(shape)
    array.setflags(write=False)
    return array
