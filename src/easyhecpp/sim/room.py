"""The laboratory around the arm: floor, table and lamps, walls and furniture, sky."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from easyhecpp.sim import textures
from easyhecpp.sim.clutter import Prop, random_item, upright
from easyhecpp.sim.materials import Material, metal, plastic, random_colour, textured
from easyhecpp.sim.panels import Lamp, PaintedPanel, Shade, painted
from easyhecpp.sim.shapes import box, merged, moved, panel
from easyhecpp.sim.skies import random_sky
from easyhecpp.sim.walls import random_walls

# The sizes below are for an arm that reaches this far, measured as Robot.reach does (xArm 7).
REFERENCE_REACH = 1.07
_FLOOR = 11.0
_LAMP_ABOVE_CAMERA = 0.2


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Everything in the cell that is neither arm nor camera.

    Attributes:
        props: floor, table and clutter: things that catch shadows.
        panels: walls, ceiling and furniture, painted with their light on them.
        lamps: light sources.
        sky: (n, 2n, 3) float32 linear radiance far away.
        sky_turn: radians by which the sky is turned about the vertical.
        description: names of the choices made, for the record.
    """

    props: tuple[Prop, ...]
    panels: tuple[PaintedPanel, ...]
    lamps: tuple[Lamp, ...]
    sky: np.ndarray
    sky_turn: float
    description: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class RoomPlan:
    """What a room is built around.

    Attributes:
        reach: of the arm, metres.
        stand_z: height in the base frame of the surface that the base is bolted to.
        on_floor: the robot stands on the floor, not on a table.
        camera_azimuth: direction from the base towards the camera, radians.
        camera_distance: horizontal distance of the camera from the base, metres.
        camera_z: height of the camera in the base frame; lamps hang above it.
        n_clutter: number of things on the table.
        n_furniture: largest number of cabinets, shelves and boxes in the background.
        n_pictures: largest number of posters on the wall.
        foreground: put something large between the camera and the foot of the arm.
    """

    reach: float
    stand_z: float
    on_floor: bool
    camera_azimuth: float
    camera_distance: float
    camera_z: float
    n_clutter: int
    n_furniture: int = 5
    n_pictures: int = 6
    foreground: bool = False

    @property
    def scale(self) -> float:
        """Size of the arm relative to the one the numbers were chosen for."""
        return self.reach / REFERENCE_REACH

    @property
    def floor_z(self) -> float:
        """Height of the floor."""
        return self.stand_z - (0.0 if self.on_floor else 0.45 + 0.3 * min(self.scale, 1.2))


@dataclass(frozen=True, eq=False)
class TableTop:
    """The rectangle that things stand on.

    Attributes:
        T_base_top: (4, 4) pose of its middle, x along the width, z up.
        width: metres.
        depth: metres.
    """

    T_base_top: np.ndarray
    width: float
    depth: float

    @classmethod
    def random(cls, rng: np.random.Generator, plan: RoomPlan) -> TableTop:
        """A table under the base, the base not in its middle."""
        width, depth = plan.scale * rng.uniform([1.0, 0.8], [2.0, 1.4])
        turn = rng.choice(4) * np.pi / 2 + rng.normal(0, 0.05)
        aside = rng.uniform(-0.25, 0.25, 2) * (width, depth)
        T = upright(0, 0, plan.stand_z, turn) @ upright(aside[0], aside[1], 0, 0)
        return cls(T, float(width), float(depth))

    @classmethod
    def on_floor(cls, plan: RoomPlan) -> TableTop:
        """The floor around a robot that has its own stand."""
        return cls(upright(0, 0, plan.stand_z, 0), 3.0 * plan.scale, 3.0 * plan.scale)

    def random_place(self, rng: np.random.Generator, clear: float) -> tuple[float, float]:
        """A place (x, y) in the base frame, ``clear`` metres or more from the base's axis."""
        x = y = 0.0
        for _ in range(50):
            local = rng.uniform(-0.44, 0.44, 2) * (self.width, self.depth)
            x, y = (self.T_base_top @ [*local, 0.0, 1.0])[:2]
            if np.hypot(x, y) > clear:
                break
        return float(x), float(y)


def random_surroundings(rng: np.random.Generator, plan: RoomPlan) -> Surroundings:
    """Furnish a room around an arm."""
    sky_name, sky = random_sky(rng)
    lamps = _lamps(rng, plan)
    ambient = 0.5 * sky.reshape(-1, 3).mean(axis=0)
    panels, wall_name = random_walls(
        rng,
        reach=plan.reach,
        floor_z=plan.floor_z,
        camera_azimuth=plan.camera_azimuth,
        camera_distance=plan.camera_distance,
        n_furniture=plan.n_furniture,
        n_pictures=plan.n_pictures,
        lamps=lamps,
        ambient=ambient,
    )
    top = TableTop.on_floor(plan)
    props: list[Prop] = []
    T_base_floor = upright(0, 0, plan.floor_z, rng.uniform(0, np.pi))
    if plan.on_floor:
        # The arm's own shadow falls here.
        floor = moved(panel(_FLOOR, _FLOOR), T_base_floor)
        props.append(Prop("floor", floor, textured(_floor_picture(rng), repeat=(6, 6))))
    else:
        top = TableTop.random(rng, plan)
        picture = np.tile(_floor_picture(rng), (6, 6, 1))
        picture = cv2.resize(picture, (1800, 1800), interpolation=cv2.INTER_AREA)
        panels.append(
            painted(
                "floor",
                T_base_floor,
                (_FLOOR, _FLOOR),
                picture,
                lamps,
                ambient,
                shades=[Shade(top.T_base_top, (top.width, top.depth))],
                cells=90,
            )
        )
        props += _table(rng, plan, top)
    props += _clutter(rng, plan, top)
    if plan.foreground:
        props += _foreground(rng, plan, top)
    description = {"sky": sky_name, "wall": wall_name, "lamps": str(len(lamps))}
    turn = float(rng.uniform(0, 2 * np.pi))
    return Surroundings(tuple(props), tuple(panels), tuple(lamps), sky, turn, description)


def _lamps(rng: np.random.Generator, plan: RoomPlan) -> list[Lamp]:
    """One to four panels overhead; the first lights the camera's side of the arm."""
    lamps = []
    warmth = np.array([1.0, rng.uniform(0.9, 1.0), rng.uniform(0.75, 1.05)])
    for i in range(int(rng.integers(1, 5))):
        spread = 0.9 if i == 0 else np.pi
        azimuth = plan.camera_azimuth + rng.uniform(-spread, spread)
        distance, height = rng.uniform(0.2, 1.6), rng.uniform(2.2, 2.8)
        x, y = distance * np.cos(azimuth), distance * np.sin(azimuth)
        # A lamp just below the camera would fill the picture with its black back.
        z = max(plan.floor_z + height, plan.camera_z + _LAMP_ABOVE_CAMERA)
        T = upright(x, y, z, azimuth) @ np.diag([1.0, -1, -1, 1])
        width, depth = rng.uniform([0.4, 0.2], [1.3, 0.7])
        power = rng.uniform(2.0, 8.0) / (width * depth)
        lamps.append(Lamp(T, (float(width), float(depth)), power * warmth))
    return lamps


def _floor_picture(rng: np.random.Generator) -> np.ndarray:
    kind = int(rng.choice(4, p=[0.45, 0.2, 0.2, 0.15]))
    colour = random_colour(rng, saturation=0.25, value=(0.25, 0.6))
    if kind == 3:
        return textures.wood(rng, (0.55, 0.38, 0.24))
    return (textures.concrete, textures.tiles, textures.carpet)[kind](rng, colour)


def _table(rng: np.random.Generator, plan: RoomPlan, top: TableTop) -> list[Prop]:
    """A table top with legs."""
    width, depth, thickness = top.width, top.depth, float(rng.uniform(0.025, 0.05))
    T = top.T_base_top
    board = moved(box((width, depth, thickness)), T @ upright(0, 0, -thickness / 2, 0))
    tall = plan.stand_z - thickness - plan.floor_z
    legs = [
        moved(box((0.06, 0.06, tall)), T @ upright(x * width, y * depth, -thickness - tall / 2, 0))
        for x in (-0.46, 0.46)
        for y in (-0.46, 0.46)
    ]
    grey = plastic(random_colour(rng, saturation=0.1, value=(0.1, 0.7)), 0.5)
    return [
        Prop("table", board, _table_material(rng)),
        Prop("legs", merged(*legs), grey if rng.random() < 0.6 else metal()),
    ]


def _table_material(rng: np.random.Generator) -> Material:
    kind = int(rng.choice(5, p=[0.3, 0.28, 0.16, 0.16, 0.10]))
    gloss = float(rng.uniform(0.3, 0.8))
    if kind == 0:
        tone = rng.uniform(0.5, 1.0)
        brown = tone * rng.uniform([0.75, 0.52, 0.32], [0.85, 0.68, 0.5])
        return textured(textures.wood(rng, brown), roughness=gloss)
    if kind == 1:
        pale = random_colour(rng, saturation=0.06, value=(0.7, 0.9))
        return textured(textures.paint(rng, pale), roughness=gloss)
    if kind == 2:
        picture = textures.brushed(rng, (0.6, 0.6, 0.62))
        return Material(roughness=0.35, metallic=0.9, texture=picture)
    if kind == 3:
        dark = random_colour(rng, saturation=0.2, value=(0.05, 0.2))
        return textured(textures.concrete(rng, dark), roughness=gloss)
    first = random_colour(rng, saturation=0.4, value=(0.1, 0.4))
    second = random_colour(rng, saturation=0.3, value=(0.5, 0.9))
    return textured(textures.checker(rng, first, second), roughness=gloss, repeat=(2, 2))


def _clutter(rng: np.random.Generator, plan: RoomPlan, top: TableTop) -> list[Prop]:
    """Things around the base, the lower the nearer."""
    props: list[Prop] = []
    for _ in range(plan.n_clutter):
        x, y = top.random_place(rng, 0.26 * plan.scale)
        distance = float(np.hypot(x, y)) / plan.scale
        size = plan.scale * rng.uniform(0.05, 0.08 + 0.16 * max(distance - 0.26, 0.0))
        T = upright(x, y, plan.stand_z, rng.uniform(0, 2 * np.pi))
        for surface, material in random_item(rng, size):
            props.append(Prop("clutter", moved(surface, T), material))
    return props


def _foreground(rng: np.random.Generator, plan: RoomPlan, top: TableTop) -> list[Prop]:
    """A large thing on the table on the camera's side, where there is table."""
    for _ in range(200):
        x, y = top.random_place(rng, 0.3 * plan.scale)
        aside = np.arctan2(y, x) - plan.camera_azimuth
        aside = np.abs((aside + np.pi) % (2 * np.pi) - np.pi)
        if aside < 0.3 and np.hypot(x, y) < 0.75 * plan.scale:
            T = upright(x, y, plan.stand_z, rng.uniform(0, 2 * np.pi))
            items = random_item(rng, plan.scale * rng.uniform(0.22, 0.36))
            return [Prop("clutter", moved(surface, T), material) for surface, material in items]
    return []
