"""Collisions of the arm with itself, by the meshes (coal, formerly hpp-fcl; extra ``plan``).

Links that always touch, because one is mounted on the other, say nothing: neighbours in the
kinematic tree are left out, and so are pairs that touch in most random poses.
"""

from __future__ import annotations

from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp._optional import available, require
from easyhecpp.errors import InputError
from easyhecpp.explore.box_check import BoxCheck
from easyhecpp.explore.candidates import draw_candidates
from easyhecpp.explore.protocols import CollisionChecker
from easyhecpp.robot import LinkMesh, Robot

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_POSES = 100
_USUALLY = 0.5


class SelfCollision:
    """Finds joint poses in which links touch that usually do not.

    Args:
        robot: The arm.
        margin: Links nearer to each other than this count as touching, metres.

    Raises:
        MissingExtraError: coal is not installed.
        InputError: The margin is negative.
    """

    def __init__(self, robot: Robot, margin: float = 0.01) -> None:
        if not 0.0 <= margin < 1.0:
            raise InputError(
                f"The distance that links must keep is {margin:g}", expected="metres, at least 0"
            )
        self._coal = require("coal", "plan", "Checking the arm for collisions with itself")
        self._robot = robot
        self._margin = margin
        self._models = [_model(self._coal, mesh) for mesh in robot.meshes]
        boxes = np.stack([[m.vertices.min(axis=0), m.vertices.max(axis=0)] for m in robot.meshes])
        self._middles = boxes.mean(axis=1)
        self._radii = np.array(
            [
                np.linalg.norm(mesh.vertices - middle, axis=1).max()
                for mesh, middle in zip(robot.meshes, self._middles, strict=True)
            ]
        )

    @property
    def description(self) -> str:
        """What it tests."""
        return (
            f"Links of the arm keep {1e3 * self._margin:.0f} mm from each other; nothing else in "
            "the cell is known."
        )

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs of links that are tested, by index."""
        parents = self._robot.link_parents
        apart = [
            (i, j)
            for i, j in combinations(range(len(parents)), 2)
            if parents[i] != j and parents[j] != i
        ]
        poses = draw_candidates(self._robot, _POSES, np.random.default_rng(0))
        often = self._touching(poses, apart).mean(axis=0) > _USUALLY
        return tuple(pair for pair, usual in zip(apart, often, strict=True) if not usual)

    def collides(self, joints: F64) -> Bool:
        """Which of the joint poses ``(N, n)`` have links that touch: ``(N,)``."""
        return np.asarray(self._touching(np.atleast_2d(joints), self.pairs).any(axis=1))

    def touching(self, joints: F64) -> tuple[tuple[str, str], ...]:
        """The names of the links that touch each other in a joint pose ``(n,)``."""
        names = self._robot.link_names
        hits = self._touching(joints[None], self.pairs)[0]
        return tuple(
            (names[i], names[j]) for (i, j), hit in zip(self.pairs, hits, strict=True) if hit
        )

    def _touching(self, joints: F64, pairs: list[tuple[int, int]] | tuple[Any, ...]) -> Bool:
        """``(N, P)``: which pairs touch in which pose."""
        touching = np.zeros((len(joints), len(pairs)), bool)
        if not pairs:
            return touching
        Ts = self._robot.link_poses(joints)
        middles = np.einsum("nlij,lj->nli", Ts[..., :3, :3], self._middles) + Ts[..., :3, 3]
        first, second = np.array(pairs).T
        gaps = np.linalg.norm(middles[:, first] - middles[:, second], axis=-1)
        near = gaps < self._radii[first] + self._radii[second] + self._margin
        request, result = self._coal.CollisionRequest(), self._coal.CollisionResult()
        request.security_margin = self._margin
        for n in np.flatnonzero(near.any(axis=1)):
            placed = [self._coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy()) for T in Ts[n]]
            for p in np.flatnonzero(near[n]):
                i, j = pairs[p]
                result.clear()
                self._coal.collide(
                    self._models[i], placed[i], self._models[j], placed[j], request, result
                )
                touching[n, p] = result.isCollision()
        return touching


def best_checker(robot: Robot) -> CollisionChecker:
    """The meshes' own test where the extra ``plan`` is installed, otherwise the one by boxes."""
    return SelfCollision(robot) if available("coal") else BoxCheck(robot)


def _model(coal: Any, mesh: LinkMesh) -> Any:
    """A link's triangles in a tree of boxes."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(mesh.vertices))
    faces = coal.StdVec_Triangle()
    faces.extend([coal.Triangle(int(a), int(b), int(c)) for a, b, c in mesh.faces])
    model.addSubModel(vertices, faces)
    model.endModel()
    return model
