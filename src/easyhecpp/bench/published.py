"""Numbers printed in papers, to stand beside ours: EasyHeC++, and what it compares itself with.

Errors are in degrees and millimetres (the papers' centimetres times ten), averages as printed.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PublishedErrors:
    """Errors by number of views.

    Attributes:
        name: Of the method.
        rotation_deg: By number of views, from one.
        position_mm: The same.
    """

    name: str
    rotation_deg: tuple[float, ...]
    position_mm: tuple[float, ...]


EYE_TO_HAND = (
    PublishedErrors(
        "EasyHeC++", (0.246, 0.076, 0.064, 0.058, 0.045), (3.18, 1.76, 1.59, 1.37, 1.35)
    ),
    PublishedErrors("EasyHeC", (0.322, 0.128, 0.109, 0.097, 0.081), (4.88, 2.98, 2.52, 2.06, 2.06)),
    PublishedErrors("DREAM", (1.924, 1.240, 0.981, 0.764, 0.704), (5.29, 4.73, 3.74, 3.47, 3.03)),
)
"""Synthetic xArm 7 before a camera on a tripod (EasyHeC++, tables I and II)."""

MARKER = PublishedErrors("marker, 20 views", (0.870,), (20.0,))
"""Tsai's solver on 20 chessboard views of the same scenes."""


@dataclass(frozen=True)
class PublishedStart:
    """A way to the first pose.

    Attributes:
        name: Of the method.
        rotation_deg, position_mm: Errors.
        time: As printed.
    """

    name: str
    rotation_deg: float
    position_mm: float
    time: str


FIRST_POSE = (
    PublishedStart("EasyHeC (PVNet)", 3.94, 24.0, "10 h training, 0.1 s"),
    PublishedStart("EasyHeC++ (sampling)", 0.10, 2.6, "10 min"),
    PublishedStart("EasyHeC++ (feature matching)", 2.33, 18.0, "6 s"),
)
"""First poses on the same scenes (EasyHeC++, ablation of the initialisation)."""

TARGETING_MM = {"DREAM": 15.0, "EasyHeC": 4.0, "EasyHeC (SAM)": 3.0, "EasyHeC++": 3.0}
"""A real xArm 7 tipping a marker's corner, measured by hand, camera on a tripod."""

PCK_2D_PX = (10, 20, 30, 40, 50, 100, 150)
PCK_2D: dict[str, tuple[float | None, ...]] = {
    "DREAM": (None, 0.16, 0.23, 0.29, 0.33, 0.52, 0.62),
    "OK": (None, 0.34, 0.54, 0.66, 0.69, 0.88, 0.93),
    "IPE (box)": (None, None, None, None, 0.65, 0.94, 0.95),
    "IPE (cylinder)": (None, None, None, None, 0.80, 0.91, 0.93),
    "IPE (CAD)": (None, None, None, None, 0.74, 0.90, 0.94),
    "EasyHeC, 1 view": (0.1, 0.35, 0.55, 0.75, 0.90, 0.95, 0.95),
    "EasyHeC, 2 views": (0.15, 0.40, 0.75, 0.95, 1.0, 1.0, 1.0),
    "EasyHeC, 3 views": (0.05, 0.55, 0.85, 1.0, 1.0, 1.0, 1.0),
    "EasyHeC++, 1 view": (0.25, 0.5, 0.75, 0.75, 0.85, 0.95, 1.0),
    "EasyHeC++, 2 views": (0.5, 0.55, 0.9, 0.9, 0.9, 1.0, 1.0),
    "EasyHeC++, 3 views": (0.5, 0.7, 0.85, 0.95, 1.0, 1.0, 1.0),
}
"""Share of images of the real Baxter whose end effector projects within so many pixels."""

PCK_3D_CM = (2, 5, 10, 20, 30, 40)
PCK_3D: dict[str, tuple[float | None, ...]] = {
    "DREAM": (0.01, 0.08, 0.32, 0.43, 0.54, 0.66),
    "OK": (0.10, 0.34, 0.54, 0.66, 0.69, 0.88),
    "IPE (box)": (None, None, 0.8, 0.95, 0.95, 0.95),
    "IPE (cylinder)": (None, None, 0.71, 0.93, 0.94, 0.95),
    "IPE (CAD)": (None, None, 0.78, 0.93, 0.97, 1.0),
    "EasyHeC, 1 view": (0.10, 0.65, 0.90, 1.0, 1.0, 1.0),
    "EasyHeC, 2 views": (0.15, 0.80, 0.95, 1.0, 1.0, 1.0),
    "EasyHeC, 3 views": (0.15, 0.80, 0.90, 1.0, 1.0, 1.0),
    "EasyHeC++, 1 view": (0.15, 0.75, 0.95, 1.0, 1.0, 1.0),
    "EasyHeC++, 2 views": (0.2, 0.6, 0.95, 1.0, 1.0, 1.0),
    "EasyHeC++, 3 views": (0.3, 0.65, 0.90, 1.0, 1.0, 1.0),
}
"""The same in space, within so many centimetres."""
