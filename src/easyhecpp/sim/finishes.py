"""The look of a robot arm: which parts of each link are shell, metal band or dark detail.

URDF meshes rarely say what a part is made of, and the truth does not depend on it. The parts are
told from the shape: the largest connected piece of a link is its shell, flat round ends are where
joints sit and get a band, small separate pieces are screws, caps and motors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from easyhecpp.robot import Robot
from easyhecpp.robot.link_mesh import LinkMesh
from easyhecpp.sim.creases import cut, face_areas, label_faces, smoothed
from easyhecpp.sim.materials import Material, metal, plastic, random_colour, shaded
from easyhecpp.sim.shapes import Surface

Part = tuple[Surface, Material]

# Metres above a flat end that still belong to it: screw heads do not, rounding does.
_ABOVE = 1e-4

WHITE, LIGHT_GREY, DARK = (0.86, 0.86, 0.85), (0.62, 0.63, 0.64), (0.07, 0.07, 0.08)


@dataclass(frozen=True, eq=False)
class ArmLook:
    """Finishes of one arm.

    Attributes:
        name: what it reminds of.
        shell: the large cover of each link.
        band: the ring at each joint, and second-largest pieces.
        detail: screws, caps, small pieces.
        band_height: metres.
    """

    name: str
    shell: Material
    band: Material
    detail: Material
    band_height: float


def random_look(rng: np.random.Generator, size: float) -> ArmLook:
    """Finishes like those of arms on the market.

    Args:
        rng: source of randomness.
        size: reach of the arm in metres; bands are scaled to it.
    """
    black, steel = plastic(DARK, 0.45), metal(roughness=float(rng.uniform(0.33, 0.5)))
    gloss = float(rng.uniform(0.18, 0.45))
    signal = plastic(random_colour(rng, saturation=0.95, value=(0.4, 0.85)), gloss)
    orange = plastic((0.86, 0.36 + 0.1 * rng.random(), 0.06), gloss)
    cast = Material(colour=LIGHT_GREY, roughness=0.38, metallic=0.75)
    looks = {
        "white with metal bands": (plastic(WHITE, gloss), steel, plastic(LIGHT_GREY)),
        "white with dark joints": (plastic(WHITE, gloss), black, black),
        "white with coloured joints": (plastic(WHITE, gloss), signal, black),
        "grey": (plastic(LIGHT_GREY, gloss), plastic((0.3, 0.31, 0.32)), black),
        "cast metal": (cast, plastic((0.22, 0.36, 0.55)), black),
        "signal colour": (orange if rng.random() < 0.6 else signal, black, steel),
        "black": (plastic((0.09, 0.09, 0.1), gloss), steel, plastic(LIGHT_GREY)),
    }
    share = [0.30, 0.16, 0.10, 0.14, 0.12, 0.12, 0.06]
    name = list(looks)[int(rng.choice(len(looks), p=share))]
    shell, band, detail = looks[name]
    shell = shaded(shell, float(rng.uniform(0.92, 1.02)))
    return ArmLook(name, shell, band, detail, float(rng.uniform(0.018, 0.05)) * size)


def dress(robot: Robot, look: ArmLook) -> tuple[tuple[Part, ...], ...]:
    """Surfaces with finishes for every link with geometry, in the order of ``link_names``."""
    return tuple(dress_link(mesh, look) for mesh in robot.meshes)


def dress_link(mesh: LinkMesh, look: ArmLook) -> tuple[Part, ...]:
    """Cut one link into parts of one finish each; the union is exactly the link's surface."""
    patch, piece = label_faces(mesh), label_faces(mesh, np.pi)
    finish = _finish_of_pieces(mesh, piece)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    for end in _joint_ends(mesh, patch, finish == 0):
        for plane in (end.offset - look.band_height, end.offset + _ABOVE):
            vertices, faces, origin = cut(vertices, faces, end.normal, plane)
            patch, finish = patch[origin], finish[origin]
        band = (finish == 0) & _band(vertices, faces, patch, end, look.band_height)
        areas = face_areas(vertices, faces)
        if areas[band].sum() < 0.45 * areas.sum():
            finish[band] = 1
    surface = smoothed(vertices, faces, patch)
    parts = []
    for value, material in enumerate((look.shell, look.band, look.detail)):
        chosen = faces_of(surface, finish == value)
        if len(chosen.faces):
            parts.append((chosen, material))
    return tuple(parts)


def faces_of(surface: Surface, chosen: np.ndarray) -> Surface:
    """The surface made of some of the faces (boolean index), without unused vertices."""
    used, index = np.unique(surface.faces[chosen], return_inverse=True)
    uvs = None if surface.uvs is None else surface.uvs[used]
    return Surface(surface.vertices[used], index.reshape(-1, 3), surface.normals[used], uvs)


def _finish_of_pieces(mesh: LinkMesh, piece: np.ndarray) -> np.ndarray:
    """(F,) 0 shell, 1 band, 2 detail, from the area of each connected piece."""
    areas = np.bincount(piece, weights=face_areas(mesh.vertices, mesh.faces))
    share = areas / areas.max()
    return np.where(share > 0.6, 0, np.where(share > 0.06, 1, 2))[piece]


@dataclass(frozen=True, eq=False)
class _JointEnd:
    """A flat round end: patch number, outward normal, and the plane ``normal . x = offset``."""

    patch: int
    normal: np.ndarray
    offset: float


def _band(
    vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray, end: _JointEnd, height: float
) -> np.ndarray:
    """(F,) the end itself and the faces below it that hang together with it, down to a height."""
    along = vertices[faces].mean(axis=1) @ end.normal
    inside = np.flatnonzero((along > end.offset - height) & (along < end.offset + _ABOVE))
    corners = faces[inside].ravel()
    rows = np.repeat(np.arange(len(inside)), 3)
    shape = (len(inside), len(vertices))
    touches = coo_matrix((np.ones(len(corners), np.int32), (rows, corners)), shape=shape).tocsr()
    piece = connected_components(touches @ touches.T, directed=False)[1]
    chosen = np.isin(piece, piece[patch[inside] == end.patch])
    band = np.zeros(len(faces), bool)
    band[inside[chosen]] = True
    return band


def _joint_ends(mesh: LinkMesh, patch: np.ndarray, shell: np.ndarray) -> list[_JointEnd]:
    """Flat round ends of the shell."""
    areas = face_areas(mesh.vertices, mesh.faces)
    normals = mesh.face_planes[:, :3]
    total = np.bincount(patch, weights=areas)
    mean = np.stack([np.bincount(patch, weights=areas * normals[:, k]) for k in range(3)], axis=1)
    flatness = np.linalg.norm(mean, axis=1) / np.maximum(total, 1e-15)
    ends = []
    big = (flatness > 0.9995) & (total > 0.04 * areas.sum())
    for index in np.flatnonzero(big & np.isin(np.arange(len(total)), patch[shell])):
        members = patch == index
        points = mesh.vertices[np.unique(mesh.faces[members])]
        normal = mean[index] / np.linalg.norm(mean[index])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = float(np.linalg.norm(points - middle, axis=1).max())
        if total[index] < 1.2 * np.pi * radius**2:
            ends.append(_JointEnd(int(index), normal, float((points @ normal).mean())))
    return ends
