"""How long the photo-real cell takes for its pictures, exact truth included."""

from __future__ import annotations

import numpy as np
from timing import measure

from easyhecpp.bench.table import Table
from easyhecpp.sim import Cell, CellOptions
from easyhecpp.sim.studio import PREVIEW, Quality, tracer

VIEWS = 5


def run(seed: int, budget_s: float) -> Table:
    """Photograph joint poses of random cells; a new cell for each scene, as the tables do."""

    def scene(number: int, width: int, height: int, views: int, quality: Quality) -> None:
        rng = np.random.default_rng([seed, number])
        cell = Cell.random("xarm7", rng, options=CellOptions(width=width, height=height))
        for view in cell.capture(cell.poses.draw(views, rng), quality=quality):
            _ = view.truth  # worked out at the first call

    rng = np.random.default_rng(seed)
    small = Cell.random("xarm7", rng, options=CellOptions(width=640, height=360))
    joints = small.poses.draw(8, rng)
    full = measure(
        lambda i: scene(i, 1280, 720, VIEWS, Quality(samples=16)), budget_s=budget_s, at_least=1
    )
    usual = measure(lambda i: scene(i, 960, 540, 6, Quality()), budget_s=budget_s, at_least=1)
    preview = measure(
        lambda i: small.capture(joints[i % len(joints)], quality=PREVIEW), budget_s=budget_s
    )
    return Table(
        title="Photo-real pictures of the xArm 7, warm",
        columns=("what", "s median", "s 95 %", "s processor", "calls"),
        rows=tuple(
            (name, s.median, s.p95, s.cpu, s.calls)
            for name, s in (
                (f"a scene of {VIEWS} views, 1280x720, 16 samples a pixel", full),
                ("a scene of 6 views, 960x540, 12 samples a pixel (`bench photo`)", usual),
                ("a preview of 640x360", preview),
            )
        ),
        notes=(
            "A scene: a new random cell, its joint poses, pictures and exact truth. Traced by "
            f"Mitsuba's {tracer()}.",
        ),
    )
