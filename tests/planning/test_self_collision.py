"""Collisions of an arm with itself against pinocchio's geometry model."""

from __future__ import annotations

import numpy as np
import pytest
from small_arm import small_arm

import easyhecpp.planning.self_collision as module
from easyhecpp.errors import InputError, MissingExtraError
from easyhecpp.explore import CollisionChecker, draw_candidates
from easyhecpp.explore.box_check import BoxCheck
from easyhecpp.planning import SelfCollision, best_checker
from easyhecpp.sim.robots import load_robot, robot_source

pin = pytest.importorskip("pinocchio", reason="needs the extra plan")
FOLDED = np.array([0.0, 1.2, 1.5, 0.0])


def test_every_pair_agrees_with_pinocchio() -> None:
    robot, source = load_robot("xarm7"), robot_source("xarm7")
    folders = [str(folder) for folder in source.package_dirs]
    model = pin.buildModelFromUrdf(str(source.path))
    links = pin.buildGeomFromUrdf(
        model, str(source.path), pin.GeometryType.VISUAL, package_dirs=folders
    )
    links.addAllCollisionPairs()
    data, links_data = model.createData(), pin.GeometryData(links)
    checker = SelfCollision(robot, margin=0.0)
    tested = {frozenset((robot.link_names[i], robot.link_names[j])) for i, j in checker.pairs}
    assert len(tested) == 21
    joints = draw_candidates(robot, 120, np.random.default_rng(5))
    n_touching = 0
    for q in joints:
        # Its joints are in the same order, its endless ones none.
        pin.computeCollisions(model, data, links, links_data, q, False)
        theirs = set()
        for pair, result in zip(links.collisionPairs, links_data.collisionResults, strict=True):
            ends = (links.geometryObjects[pair.first], links.geometryObjects[pair.second])
            names = frozenset(end.name.rsplit("_", 1)[0] for end in ends)
            if names in tested and result.isCollision():
                theirs.add(names)
        assert {frozenset(pair) for pair in checker.touching(q)} == theirs
        n_touching += bool(theirs)
    assert 2 <= n_touching <= 40
    assert checker.collides(joints).sum() == n_touching


def test_a_folded_arm_and_one_that_is_not() -> None:
    robot = small_arm()
    checker = SelfCollision(robot)
    assert isinstance(checker, CollisionChecker)
    assert checker.collides(np.stack([robot.neutral, FOLDED])).tolist() == [False, True]
    assert ("shoulder", "hand") in checker.touching(FOLDED)
    assert checker.touching(robot.neutral) == ()


def test_the_margin_is_a_distance() -> None:
    robot = small_arm()
    joints = draw_candidates(robot, 200, np.random.default_rng(0))
    close, far = SelfCollision(robot, 0.0), SelfCollision(robot, 0.05)
    a, b = close.collides(joints), far.collides(joints)
    assert np.all(b[a])
    assert b.sum() > a.sum()
    assert "50 mm" in far.description


def test_bad_margin() -> None:
    with pytest.raises(InputError, match="at least 0"):
        SelfCollision(small_arm(), -0.1)


def test_without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "available", lambda name: False)
    checker = best_checker(small_arm())
    assert isinstance(checker, BoxCheck)
    assert 'install "easyhecpp[plan]"' in checker.description

    def missing(name: str, extra: str, feature: str) -> None:
        raise MissingExtraError(name, extra, feature)

    monkeypatch.setattr(module, "require", missing)
    with pytest.raises(MissingExtraError, match=r"pip install \"easyhecpp\[plan\]\""):
        SelfCollision(small_arm())
