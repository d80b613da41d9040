"""The robot as the rest of the package sees it: joints, frames and link meshes, immutable."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from easyhecpp import geometry as se3
from easyhecpp._paths import expanded
from easyhecpp.errors import InputError
from easyhecpp.robot.kinematics import KinematicTree
from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.robot.urdf import Geometry


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot read from a URDF. Made by `Robot.from_urdf`.

    n actuated joints in the URDF's document order, L links with geometry, metres and radians.

    Attributes:
        name: name in the URDF.
        joint_names: the n actuated joints of the whole tree (mimic and fixed joints are not).
        joint_types: their types, `revolute`, `continuous` or `prismatic`.
        lower: (n,) lower limits; -pi for a continuous joint.
        upper: (n,) upper limits; pi for a continuous joint.
        base_link: the link whose frame is `base`.
        link_names: the L links that have geometry and are not ignored.
        meshes: their meshes, in link frames, parallel to `link_names`.
        frame_names: all links of the URDF.
        geometry: `visual` or `collision`, which of the two the meshes are.
        undrawn_links: links that have geometry of the other kind only, and so no mesh.
        tree: the kinematics.
    """

    name: str
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    base_link: str
    link_names: tuple[str, ...]
    meshes: tuple[LinkMesh, ...]
    frame_names: tuple[str, ...]
    geometry: Geometry
    undrawn_links: tuple[str, ...]
    tree: KinematicTree = field(repr=False)

    @classmethod
    def from_urdf(
        cls,
        path: str | os.PathLike[str],
        *,
        package_dirs: Sequence[str | os.PathLike[str]] = (),
        base_link: str | None = None,
        ignore_links: Iterable[str] = (),
        geometry: Geometry = "visual",
    ) -> Robot:
        """Read a URDF, or a xacro file, with the meshes it names.

        Args:
            path: the `.urdf` or `.xacro` file.
            package_dirs: where to look for `package://` first: packages or folders of packages.
            base_link: the base frame; by default the first link with geometry met when walking
                down from the root through fixed joints.
            ignore_links: links whose geometry is left out, such as a tool that is not mounted.
            geometry: `visual`, or `collision` for a robot whose visual meshes are not at hand.

        Raises:
            InputError: anything wrong with the URDF or its meshes; missing meshes are all listed.
        """
        from easyhecpp.robot.loading import load_robot

        return load_robot(
            expanded(path),
            package_dirs=package_dirs,
            base_link=base_link,
            ignore_links=ignore_links,
            geometry=geometry,
        )

    @property
    def n_joints(self) -> int:
        """Number of actuated joints."""
        return len(self.joint_names)

    @property
    def n_faces(self) -> int:
        """Number of triangles of all links."""
        return sum(len(mesh.faces) for mesh in self.meshes)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about the geometry, sentences."""
        notes = []
        if self.geometry == "collision":
            notes.append(
                "The robot is drawn by its collision geometry, which is often coarser or thicker "
                "than what a picture shows."
            )
        if self.undrawn_links:
            other = "collision" if self.geometry == "visual" else "visual"
            notes.append(
                f"Links with {other} but no {self.geometry} geometry are left out of the picture: "
                f"{', '.join(self.undrawn_links)}."
            )
        return tuple(notes)

    @property
    def mesh_error(self) -> float:
        """Metres by which any surface, and so any silhouette, may be off; see `LinkMesh.error`."""
        return max((mesh.error for mesh in self.meshes), default=0.0)

    @cached_property
    def link_parents(self) -> tuple[int, ...]:
        """For each link with geometry the index of the next one towards the root, -1 for none."""
        frames = [self.frame_names.index(name) for name in self.link_names]
        return tuple(self._next_link_above(frame, frames) for frame in frames)

    @cached_property
    def neutral(self) -> np.ndarray:
        """(n,) middle of each joint's range; of a turning joint's range within -pi..pi if any."""
        lower, upper = self._search_limits
        middle = (lower + upper) / 2.0
        middle.setflags(write=False)
        return middle

    @cached_property
    def reach(self) -> float:
        """Largest distance of a surface point from the base's origin found over poses, metres."""
        from easyhecpp.robot.extent import sampled_reach

        return sampled_reach(self, *self._search_limits)

    def link_poses(self, q: np.ndarray) -> np.ndarray:
        """Poses of the links with geometry.

        Args:
            q: (..., n) joint values.

        Returns:
            (..., L, 4, 4) Ts_base_link, in the order of `link_names`.
        """
        return self._poses(q, self._link_frames)

    def frame_pose(self, q: np.ndarray, frame: str) -> np.ndarray:
        """Pose of any link of the URDF, with or without geometry.

        Args:
            q: (..., n) joint values.
            frame: one of `frame_names`.

        Returns:
            (..., 4, 4) T_base_frame.
        """
        check_links([frame], self.frame_names, "frame")
        return self._poses(q, np.array([self.frame_names.index(frame)]))[..., 0, :, :]

    def centre(self, q: np.ndarray) -> np.ndarray:
        """Middle of the arm: the area-weighted centroid of all surfaces.

        Args:
            q: (..., n) joint values.

        Returns:
            (..., 3) in base.
        """
        areas = np.array([mesh.area for mesh in self.meshes])
        centroids = np.array([mesh.centroid for mesh in self.meshes])
        points = se3.transform_points(self.link_poses(q), centroids[:, None, :])[..., 0, :]
        return np.einsum("l,...li->...i", areas / areas.sum(), points)

    def sag(self, q: np.ndarray) -> np.ndarray:
        """How far each joint hangs below what it reads, for one unit of give.

        Args:
            q: (..., n) joint values.

        Returns:
            (..., n) radians for each radian that the joint gives way that carries most when the arm
            is stretched out; see `easyhecpp.robot.gravity`.
        """
        from easyhecpp.robot.gravity import loads

        return loads(self, q) / self._largest_load

    def simplified(self, max_error: float) -> Robot:
        """The same robot with as few triangles as `max_error` allows.

        Args:
            max_error: metres by which any surface, and so any silhouette, may move.

        Returns:
            A robot whose `mesh_error` says what was measured.
        """
        from easyhecpp.robot.simplify import simplify_mesh

        return replace(self, meshes=tuple(simplify_mesh(mesh, max_error) for mesh in self.meshes))

    def without_links(self, names: Iterable[str]) -> Robot:
        """The same robot without the geometry of some links.

        Raises:
            InputError: a name is unknown, or no geometry would be left.
        """
        names = tuple(names)
        check_links(names, self.frame_names, "links to leave out")
        kept = [i for i, name in enumerate(self.link_names) if name not in names]
        if not kept:
            raise InputError(
                "No link with geometry is left",
                expected=f"at least one of {', '.join(self.link_names)}",
                fix="Ignore fewer links",
            )
        return replace(
            self,
            link_names=tuple(self.link_names[i] for i in kept),
            meshes=tuple(self.meshes[i] for i in kept),
        )

    def _next_link_above(self, frame: int, link_frames: list[int]) -> int:
        above = int(self.tree.frames_above[frame])
        while above >= 0 and above not in link_frames:
            above = int(self.tree.frames_above[above])
        return link_frames.index(above) if above >= 0 else -1

    @cached_property
    def _link_frames(self) -> np.ndarray:
        return np.array([self.frame_names.index(name) for name in self.link_names], np.intp)

    @cached_property
    def _largest_load(self) -> float:
        from easyhecpp.robot.gravity import largest_load

        return largest_load(self, *self._search_limits)

    @cached_property
    def _search_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Limits with turning joints cut to -pi..pi, where that leaves something."""
        turns = np.array([kind != "prismatic" for kind in self.joint_types], bool)
        cut = turns & (self.lower < np.pi) & (self.upper > -np.pi)
        lower = np.where(cut, np.maximum(self.lower, -np.pi), self.lower)
        return lower, np.where(cut, np.minimum(self.upper, np.pi), self.upper)

    def _poses(self, q: np.ndarray, frames: np.ndarray) -> np.ndarray:
        q = np.asarray(q, dtype=np.float64)
        if q.ndim == 0 or q.shape[-1] != self.n_joints:
            raise InputError(
                f"Joint values have the shape {q.shape}",
                expected=f"(..., {self.n_joints}) for the joints {', '.join(self.joint_names)}",
            )
        if not np.isfinite(q).all():
            raise InputError("Joint values are not finite", expected="radians and metres")
        base = self.frame_names.index(self.base_link)
        batch = q.reshape(math.prod(q.shape[:-1]), self.n_joints)
        Ts_root_frame = self.tree.frame_poses(batch, np.append(frames, base))
        Ts_base_frame = se3.inverse(Ts_root_frame[:, -1:]) @ Ts_root_frame[:, :-1]
        return Ts_base_frame.reshape(*q.shape[:-1], len(frames), 4, 4)


def check_links(names: Iterable[str], known: Sequence[str], where: str) -> None:
    """Raise an `InputError` that lists the known links when one of `names` is not among them."""
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(
            f"No link is called {' or '.join(map(repr, unknown))}",
            where=where,
            expected=f"one of {', '.join(known)}",
        )
