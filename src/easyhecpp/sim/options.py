"""What may be chosen about random simulated cells, and four ready choices."""

from __future__ import annotations

from dataclasses import dataclass

from easyhecpp.errors import InputError
from easyhecpp.rig import Setup, rides_on_arm


@dataclass(frozen=True)
class CellOptions:
    """Options of `easyhecpp.sim.cell.Cell.random`.

    The defaults follow the published simulated experiments: 1280 x 720, 0.9 to 1.5 m from an
    xArm 7 (in proportion to the reach for others), 10 to 70 degrees up, within 60 degrees of the
    front.

    Attributes:
        width: of the picture, pixels.
        height: of the picture, pixels.
        setup: ``eye-to-hand`` or ``eye-in-hand``.
        ee_link: link that a wrist camera rides on; known for robots by name.
        distortion: plumb_bob coefficients, empty for none.
        azimuth_deg: largest angle of the camera off the arm's front; 180 for anywhere.
        elevation_deg: lowest and highest camera.
        roll_deg: largest turn of the camera about its axis, either way; 180 for any.
        distance: nearest and farthest camera, metres, for an arm that reaches 1.07 m.
        min_visible: least share of what moves, seen from the camera's mount, in view in random
            poses; by default 0.7 for a camera beside the arm and 0.15 for one on it.
        clutter: fewest and most things on the table.
        foreground: probability of something large between the camera and the arm's foot.
        furniture: most pieces of furniture.
        pictures: most pictures on the wall.
        distractor: probability of a second arm.
        distractor_moves: probability that it moves between views.
        same_arm: probability that it is the same model in the same colours.
        noise: 0 for none, 1 for an indoor webcam.
        flicker: standard deviation of the log exposure from view to view.
    """

    width: int = 1280
    height: int = 720
    setup: Setup = "eye-to-hand"
    ee_link: str | None = None
    distortion: tuple[float, ...] = ()
    azimuth_deg: float = 60.0
    elevation_deg: tuple[float, float] = (10.0, 70.0)
    roll_deg: float = 0.0
    distance: tuple[float, float] = (0.9, 1.5)
    min_visible: float | None = None
    clutter: tuple[int, int] = (3, 9)
    foreground: float = 0.15
    furniture: int = 5
    pictures: int = 6
    distractor: float = 0.25
    distractor_moves: float = 0.4
    same_arm: float = 0.4
    noise: float = 1.0
    flicker: float = 0.03

    @property
    def least_visible(self) -> float:
        """``min_visible``, or its default for the set-up."""
        if self.min_visible is not None:
            return self.min_visible
        return 0.15 if rides_on_arm(self.setup) else 0.7


DIFFICULTIES = {
    "easy": CellOptions(
        clutter=(0, 3),
        foreground=0.0,
        furniture=2,
        pictures=2,
        distractor=0.0,
        noise=0.5,
        flicker=0.0,
    ),
    "normal": CellOptions(),
    "anywhere": CellOptions(azimuth_deg=180.0, elevation_deg=(0.0, 90.0), roll_deg=180.0),
    "hard": CellOptions(
        azimuth_deg=180.0,
        clutter=(8, 16),
        foreground=0.7,
        furniture=8,
        distractor=0.7,
        distractor_moves=0.6,
        same_arm=0.6,
        noise=1.8,
        flicker=0.10,
    ),
}


def options_for(difficulty: str) -> CellOptions:
    """The options of a difficulty.

    Raises:
        InputError: there is no such difficulty.
    """
    if difficulty not in DIFFICULTIES:
        raise InputError(
            f"There is no difficulty {difficulty!r}", expected="one of " + ", ".join(DIFFICULTIES)
        )
    return DIFFICULTIES[difficulty]
