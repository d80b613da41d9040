"""How long one mask of the xArm 7 takes: ours, embree through trimesh, and Open3D."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from timing import Seconds, measure

from easyhecpp._optional import available
from easyhecpp.bench.table import Table
from easyhecpp.geometry import inverse, transform_points
from easyhecpp.render import SilhouetteRenderer
from easyhecpp.render.reference_compiled import reference_coverage_compiled
from easyhecpp.robot import Robot
from easyhecpp.sim.robots import load_robot
from easyhecpp.sim.scenes import SimScene, random_scene

F64 = NDArray[np.float64]
Way = Callable[[F64], NDArray[Any]]


def run(seed: int, budget_s: float) -> Table:
    """Time every way on the same poses; kinematics and contours are part of the time."""
    scene = random_scene(load_robot("xarm7"), np.random.default_rng(seed), n_views=8)
    views = [_View(scene, i) for i in range(len(scene))]
    rows = []
    for name, faces, way in _ways(scene):
        seconds = _time(way, scene, budget_s)
        error = np.mean([view.error(way(view.joints)) for view in views[:3]])
        rows.append(
            (
                name, faces, 1e3 * seconds.median, 1e3 * seconds.p95, 1e3 * seconds.cpu,
                float(error), seconds.calls,
            )
        )  # fmt: skip
    return Table(
        title=f"One mask of the xArm 7 at {scene.camera.width}x{scene.camera.height}, one core",
        columns=(
            "way", "faces", "ms median", "ms 95 %", "ms processor", "coverage error", "calls",
        ),
        rows=tuple(rows),
        notes=(
            "From joint positions to a mask: kinematics and contours included. The error is the "
            "mean absolute difference from the reference (9x9 samples a pixel) over the pixels "
            "that the outline runs through; ray casting looks at pixel centres only.",
        ),
    )  # fmt: skip


def _time(way: Way, scene: SimScene, budget_s: float) -> Seconds:
    return measure(lambda i: way(scene.joints[i % len(scene)]), budget_s=budget_s)


@dataclass(frozen=True)
class _View:
    scene: SimScene
    number: int

    @property
    def joints(self) -> F64:
        return self.scene.joints[self.number]

    def error(self, coverage: NDArray[Any]) -> float:
        exact = reference_coverage_compiled(
            self.scene.robot.meshes, self.scene.camera, self.scene.Ts_cam_link[self.number], 9
        )
        edge = (exact > 0.0) & (exact < 1.0)
        return float(np.abs(coverage.astype(np.float64) - exact)[edge].mean())


def _ways(scene: SimScene) -> list[tuple[str, int, Way]]:
    ways = [_ours(scene, scene.robot, "ours")]
    small = scene.robot.simplified(0.006 * scene.robot.reach)
    ways.append(_ours(scene, small, "ours, simplified for the first pose"))
    ways.append(_with_jacobian(scene))
    ways.append(_contour(scene))
    if available("embreex"):
        ways += _embree(scene)
    if available("open3d"):
        ways.append(_open3d(scene))
    return ways


def _posed(scene: SimScene, robot: Robot, joints: F64) -> F64:
    return inverse(scene.T_base_cam) @ robot.link_poses(joints)


def _ours(scene: SimScene, robot: Robot, name: str) -> tuple[str, int, Way]:
    renderer = SilhouetteRenderer(robot.meshes, scene.camera)
    return name, robot.n_faces, lambda q: renderer.coverage(_posed(scene, robot, q))


def _with_jacobian(scene: SimScene) -> tuple[str, int, Way]:
    renderer = SilhouetteRenderer(scene.robot.meshes, scene.camera)
    centre = transform_points(inverse(scene.T_base_cam), scene.robot.centre(scene.joints[0]))

    def way(q: F64) -> NDArray[Any]:
        return renderer.coverage_with_jacobian(_posed(scene, scene.robot, q), centre)[0]

    return "ours, with its derivative", scene.robot.n_faces, way


def _contour(scene: SimScene) -> tuple[str, int, Way]:
    renderer = SilhouetteRenderer(scene.robot.meshes, scene.camera)
    centre = transform_points(inverse(scene.T_base_cam), scene.robot.centre(scene.joints[0]))

    def way(q: F64) -> NDArray[Any]:
        return renderer.contour(_posed(scene, scene.robot, q), centre)[1]

    return "ours, with samples of the outer contour", scene.robot.n_faces, way


def _rays(scene: SimScene) -> F64:
    rows, columns = np.mgrid[: scene.camera.height, : scene.camera.width]
    return scene.camera.unproject(np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float))


def _triangles(scene: SimScene, joints: F64) -> tuple[F64, NDArray[np.int64]]:
    """All links as one mesh in the camera's frame."""
    meshes = scene.robot.meshes
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    posed = [
        transform_points(T, m.vertices)
        for T, m in zip(_posed(scene, scene.robot, joints), meshes, strict=True)
    ]
    faces = [m.faces + start for m, start in zip(meshes, starts[:-1], strict=True)]
    return np.concatenate(posed), np.concatenate(faces)


def _embree(scene: SimScene) -> list[tuple[str, int, Way]]:
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    directions = _rays(scene)
    origins = np.zeros_like(directions)
    shape = (scene.camera.height, scene.camera.width)
    kept: dict[bytes, Any] = {}

    def build(q: F64) -> Any:
        vertices, faces = _triangles(scene, q)
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        return RayMeshIntersector(mesh, scale_to_box=False)

    def whole(q: F64) -> NDArray[Any]:
        return build(q).intersects_any(origins, directions).reshape(shape)

    def cast(q: F64) -> NDArray[Any]:
        key = q.tobytes()
        if key not in kept:
            kept[key] = build(q)
        return kept[key].intersects_any(origins, directions).reshape(shape)

    faces = scene.robot.n_faces
    return [
        ("embree through trimesh", faces, whole),
        ("embree through trimesh, rays only (tree kept)", faces, cast),
    ]


def _open3d(scene: SimScene) -> tuple[str, int, Way]:
    import open3d as o3d

    directions = _rays(scene).astype(np.float32)
    rays = o3d.core.Tensor(np.concatenate([np.zeros_like(directions), directions], axis=1))
    shape = (scene.camera.height, scene.camera.width)

    def way(q: F64) -> NDArray[Any]:
        vertices, faces = _triangles(scene, q)
        cast = o3d.t.geometry.RaycastingScene(nthreads=1)
        cast.add_triangles(
            o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(faces.astype(np.uint32))
        )
        return cast.test_occlusions(rays, nthreads=1).numpy().reshape(shape)

    return "Open3D ray casting", scene.robot.n_faces, way
