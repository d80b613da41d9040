"""Path-traced pictures of the cell with Mitsuba.

Its variant ``scalar_rgb`` needs nothing but its wheel. Where the environment variable
``DRJIT_LIBLLVM_PATH`` names an LLVM library, ``llvm_ad_rgb`` traces the same light in half the
time, with other noise.

The studio turns finishes and what does not move into Mitsuba objects once; a picture then only
places the links and the camera. Links are placed as triangles, not as instances: building the tree
over all of them takes a tenth of a second, rays through it are an eighth faster.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

from easyhecpp._optional import require
from easyhecpp.camera import Camera
from easyhecpp.errors import InputError
from easyhecpp.sim.clutter import Prop
from easyhecpp.sim.denoise import denoised
from easyhecpp.sim.finishes import Part
from easyhecpp.sim.materials import Material
from easyhecpp.sim.panels import Lamp, PaintedPanel, to_linear
from easyhecpp.sim.room import Surroundings
from easyhecpp.sim.shapes import Surface, moved

# A mirror that reflects nothing ends a path: at matt black, a ray to a lamp would still be traced.
_BLACK = {
    "type": "conductor",
    "material": "none",
    "specular_reflectance": {"type": "rgb", "value": 0.0},
}

# OpenCV's optical axes (x right, y down) seen from Mitsuba's (x left, y up).
_FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Quality:
    """How much work goes into a picture.

    Attributes:
        samples: light paths per pixel.
        depth: bounces of light: 1 is light straight from the lamps, without reflections in what
            is seen; 2 and more are complete up to that many.
        denoise: average what looks alike; 8 samples are then nearer to the limit than 16 without.
    """

    samples: int = 12
    depth: int = 2
    denoise: bool = True


FULL = Quality()
PREVIEW = Quality(samples=2, depth=1)


@lru_cache(maxsize=1)
def _load_mitsuba() -> ModuleType:
    return require("mitsuba", "sim", "The simulated cell")


_LLVM = "DRJIT_LIBLLVM_PATH"


def tracer() -> str:
    """The variant of Mitsuba that traces: ``llvm_ad_rgb`` only where a library was named.

    An LLVM that happens to be installed is not taken: versions before 16 lack instructions that
    Mitsuba needs and end the process, and pictures should not differ from machine to machine.
    """
    return "llvm_ad_rgb" if os.environ.get(_LLVM) else "scalar_rgb"


def mitsuba() -> ModuleType:
    """Mitsuba with the variant that this package needs selected.

    Raises:
        MissingExtraError: it is not installed.
        InputError: the LLVM library that was named cannot be used.
    """
    mi = _load_mitsuba()
    if mi.variant() != tracer():
        try:
            mi.set_variant(tracer())
        except ImportError as error:
            raise InputError(
                f"{_LLVM} names no LLVM library",
                where=os.environ.get(_LLVM),
                expected="the file of a shared library of LLVM 16 or newer, libLLVM*.so*",
                fix="Install one (on Debian and Ubuntu: apt-get install libllvm19), or unset the "
                "variable: pictures are then traced without it, in twice the time",
            ) from error
        mi.set_log_level(mi.LogLevel.Warn)
    return mi


def _bsdf(material: Material) -> dict[str, Any]:
    mi = mitsuba()
    if material.texture is None:
        # The albedo is a reflectance, which is linear; colours are given as they look.
        colour = {"type": "rgb", "value": [_linear(c) for c in material.colour]}
    else:
        u, v = material.repeat
        colour = {
            "type": "bitmap",
            # Linear beforehand: Mitsuba would take a power at every look-up of an 8-bit picture.
            "bitmap": mi.Bitmap(to_linear(material.texture)),
            "raw": True,
            "to_uv": mi.ScalarTransform4f().scale([u, v, 1.0]),
        }
    if material.metallic == 0.0 and material.coat == 0.0 and material.roughness >= 0.6:
        return {"type": "diffuse", "reflectance": colour}
    inner = {
        "type": "principled",
        "base_color": colour,
        "roughness": material.roughness,
        "metallic": material.metallic,
        "clearcoat": material.coat,
        "clearcoat_gloss": 0.9,
    }
    return {"type": "twosided", "bsdf": inner}


def _linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def _mesh(name: str, surface: Surface, bsdf: Any) -> Any:
    mi = mitsuba()
    props = mi.Properties()
    props["bsdf"] = bsdf
    mesh = mi.Mesh(
        name,
        len(surface.vertices),
        len(surface.faces),
        props=props,
        has_vertex_normals=True,
        has_vertex_texcoords=surface.uvs is not None,
    )
    values = mi.traverse(mesh)
    values["vertex_positions"] = surface.vertices.astype(np.float32).ravel()
    values["faces"] = surface.faces.astype(np.uint32).ravel()
    values["vertex_normals"] = surface.normals.astype(np.float32).ravel()
    if surface.uvs is not None:
        values["vertex_texcoords"] = surface.uvs.astype(np.float32).ravel()
    values.update()
    return mesh


def _glowing(T: np.ndarray, size: tuple[float, float], radiance: Any, weight: float) -> Any:
    mi = mitsuba()
    stretch = np.diag([size[0] / 2, size[1] / 2, 1.0, 1.0])
    return mi.load_dict(
        {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(T @ stretch),
            "bsdf": _BLACK,
            "emitter": {"type": "area", "radiance": radiance, "sampling_weight": weight},
        }
    )


def limit_threads(count: int) -> None:
    """Let Mitsuba use that many threads in this process; by default it takes every core."""
    mitsuba()
    require("drjit", "sim", "The simulated cell").set_thread_count(count)


class Studio:
    """A furnished cell, ready to be photographed.

    Args:
        surroundings: the room.
        more: further things that do not move.
        arms: for each arm, for each of its links, the parts with their finishes.
    """

    def __init__(
        self,
        surroundings: Surroundings,
        more: Sequence[Prop],
        arms: Sequence[Sequence[Sequence[Part]]],
    ) -> None:
        mi = mitsuba()
        self._still: dict[str, Any] = {"sky": self._sky(surroundings)}
        for index, prop in enumerate((*surroundings.props, *more)):
            self._still[f"prop{index}"] = self._prop(index, prop)
        for index, panel in enumerate(surroundings.panels):
            self._still[f"panel{index}"] = self._panel(panel)
        for index, lamp in enumerate(surroundings.lamps):
            self._still[f"lamp{index}"] = self._lamp(lamp)
        materials = {id(m): m for arm in arms for parts in arm for _, m in parts}
        finishes = {key: mi.load_dict(_bsdf(m)) for key, m in materials.items()}
        self._arms = [
            [[(surface, finishes[id(material)]) for surface, material in parts] for parts in arm]
            for arm in arms
        ]

    @staticmethod
    def _sky(surroundings: Surroundings) -> Any:
        mi = mitsuba()
        T = mi.ScalarTransform4f
        turn = T().rotate([0, 0, 1], float(np.degrees(surroundings.sky_turn)))
        sky = {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(surroundings.sky)),
            "to_world": turn @ T().rotate([1, 0, 0], 90),
            # About what a lamp 2 m away of that radiance times area would give.
            "sampling_weight": 8.0 * float(surroundings.sky.mean()),
        }
        return mi.load_dict(sky)

    @staticmethod
    def _prop(index: int, prop: Prop) -> Any:
        return _mesh(f"{prop.name}{index}", prop.surface, mitsuba().load_dict(_bsdf(prop.material)))

    @staticmethod
    def _lamp(lamp: Lamp) -> Any:
        radiance = {"type": "rgb", "value": [float(v) for v in lamp.radiance]}
        power = float(lamp.radiance.mean()) * lamp.size[0] * lamp.size[1]
        return _glowing(lamp.T_base_lamp, lamp.size, radiance, power)

    @staticmethod
    def _panel(panel: PaintedPanel) -> Any:
        mi = mitsuba()
        bitmap = mi.Bitmap(np.ascontiguousarray(panel.radiance[::-1]))
        radiance = {"type": "bitmap", "bitmap": bitmap, "raw": True}
        # Weight 0: panels are large and even, so paths find them by themselves.
        return _glowing(panel.T_base_panel, panel.size, radiance, 0.0)

    def photograph(
        self,
        camera: Camera,
        T_base_cam: np.ndarray,
        Ts_base_link: Sequence[np.ndarray],
        quality: Quality,
        seed: int,
    ) -> np.ndarray:
        """Trace one picture.

        Args:
            camera: without distortion and with square pixels, see `easyhecpp.sim.lens`.
            T_base_cam: (4, 4).
            Ts_base_link: for each arm (L, 4, 4), all in the base frame of the first.
            quality: how much work to do.
            seed: the same seed gives the same picture, whatever the number of threads.

        Returns:
            (H, W, 3) float32 linear radiance.
        """
        mi = mitsuba()
        scene = dict(self._still, type="scene", integrator=_integrator(quality))
        scene["sensor"] = _sensor(camera, T_base_cam, quality)
        for number, (arm, poses) in enumerate(zip(self._arms, Ts_base_link, strict=True)):
            for link, (parts, T) in enumerate(zip(arm, poses, strict=True)):
                for k, (surface, bsdf) in enumerate(parts):
                    name = f"arm{number}link{link}part{k}"
                    scene[name] = _mesh(name, moved(surface, T), bsdf)
        loaded = mi.load_dict(scene)
        if not quality.denoise:
            return np.array(mi.render(loaded, spp=quality.samples, seed=seed), np.float32)
        halves = [
            np.array(mi.render(loaded, spp=max(1, quality.samples // 2), seed=s), np.float32)
            for s in (seed, seed ^ 0x5BD1E995)
        ]
        return denoised(*halves)


def _integrator(quality: Quality) -> dict[str, Any]:
    if quality.depth == 1:
        return {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    return {"type": "path", "max_depth": quality.depth + 1, "rr_depth": 2}


def _sensor(camera: Camera, T_base_cam: np.ndarray, quality: Quality) -> dict[str, Any]:
    """Mitsuba measures from the image's edge and moves the picture, not the principal point."""
    mi = mitsuba()
    return {
        "type": "perspective",
        "fov": float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))),
        "fov_axis": "x",
        "principal_point_offset_x": 0.5 - (camera.cx + 0.5) / camera.width,
        "principal_point_offset_y": 0.5 - (camera.cy + 0.5) / camera.height,
        "near_clip": 0.01,
        "far_clip": 100.0,
        "to_world": mi.ScalarTransform4f(np.asarray(T_base_cam, float) @ _FLIP),
        "film": {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "multijitter", "sample_count": quality.samples},
    }
