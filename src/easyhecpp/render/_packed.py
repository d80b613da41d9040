"""The meshes of all links in the flat arrays that the compiled kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from easyhecpp.robot import LinkMesh

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


@dataclass(frozen=True)
class PackedMeshes:
    """Concatenated link meshes; ``*_start`` ``(L+1,)`` mark where each link begins.

    Attributes:
        vertices: ``(V, 3)`` metres, each in its link's frame.
        boxes: ``(L, 6)`` lowest and highest corner of each link's vertices.
        planes: ``(4, F)`` unit normal and offset per face, one row per component.
        faces: ``(F, 3)`` global vertex indices.
        edges: ``(E, 2)`` global vertex indices.
        edge_faces: ``(E, 2)`` global face indices; the first face walks along the edge, the second
            against it; ``F`` stands for "no face".
    """

    vertices: F64
    vertex_start: I32
    boxes: F64
    planes: NDArray[np.float32]
    faces: I32
    face_start: I32
    edges: NDArray[np.uint32]
    edge_faces: NDArray[np.uint32]
    edge_start: I32

    @property
    def n_links(self) -> int:
        return len(self.vertex_start) - 1

    @classmethod
    def from_meshes(cls, meshes: Sequence[LinkMesh]) -> PackedMeshes:
        """Pack the meshes of all links, in order."""
        v_start = np.cumsum([0, *(len(m.vertices) for m in meshes)])
        f_start = np.cumsum([0, *(len(m.faces) for m in meshes)])
        e_start = np.cumsum([0, *(len(m.edges) for m in meshes)])
        n_faces = int(f_start[-1])
        faces = _stack([m.faces + v for m, v in zip(meshes, v_start, strict=False)], 3, np.int32)
        edges = _stack([m.edges + v for m, v in zip(meshes, v_start, strict=False)], 2, np.uint32)
        edge_faces = _stack(
            [
                np.where(m.edge_faces >= 0, m.edge_faces + f, n_faces)
                for m, f in zip(meshes, f_start, strict=False)
            ],
            2,
            np.uint32,
        )
        planes = _stack([m.face_planes for m in meshes], 4, np.float32)
        return cls(
            vertices=_stack([m.vertices for m in meshes], 3, np.float64),
            vertex_start=v_start.astype(np.int32),
            boxes=_stack([_box(m.vertices) for m in meshes], 6, np.float64),
            planes=np.ascontiguousarray(planes.T),
            faces=faces,
            face_start=f_start.astype(np.int32),
            edges=edges,
            edge_faces=edge_faces,
            edge_start=e_start.astype(np.int32),
        )


def _stack(parts: list[NDArray[Any]], width: int, dtype: Any) -> NDArray[Any]:
    if not parts:
        return np.zeros((0, width), dtype)
    return np.ascontiguousarray(np.concatenate(parts), dtype=dtype)


def _box(vertices: F64) -> F64:
    if len(vertices) == 0:
        return np.zeros((1, 6))
    return np.concatenate([vertices.min(axis=0), vertices.max(axis=0)])[None]
