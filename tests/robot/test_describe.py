from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from easyhecpp.robot import Robot, describe

from .urdf_text import BOX, joint


def test_a_small_robot(write_urdf: Callable[[str], Path]) -> None:
    collision = BOX.replace("visual", "collision")
    body = f'<link name="w"/><link name="a">{BOX}</link><link name="b">{collision}</link>'
    body += joint("fix", "w", "a", "fixed") + joint("turn", "a", "b", "continuous")
    body += '<link name="c"/>' + joint("slide", "b", "c", "prismatic")
    summary = describe(Robot.from_urdf(write_urdf(body)))
    assert (summary.name, summary.base_link, summary.faces) == ("test", "a", 12)
    assert [(j.name, j.type, j.unit) for j in summary.joints] == [
        ("turn", "continuous", "rad"),
        ("slide", "prismatic", "m"),
    ]
    assert summary.joints[1].upper == 1.0
    assert [(k.name, k.faces, k.open_edges, k.size) for k in summary.links] == [
        ("a", 12, 0, (1.0, 1.0, 1.0))
    ]
    assert summary.frames == ("w", "a", "b", "c")
    assert summary.missing == ("b",)
    assert "b" in summary.notes[0]
    assert summary.reach == pytest.approx(3**0.5 / 2)
    assert json.loads(json.dumps(dataclasses.asdict(summary)))["joints"][0]["name"] == "turn"
