"""The benchmark itself, with a calibration that knows the truth in place of the real one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from easyhecpp.bench.solve import (
    CASES,
    FAULTY_VIEW,
    Case,
    Outcome,
    run_solve_bench,
)
from easyhecpp.bench.solve_table import solve_table
from easyhecpp.camera import Camera
from easyhecpp.errors import CalibrationError
from easyhecpp.geometry import exp_se3
from easyhecpp.rig import Rig
from easyhecpp.robot import Robot
from easyhecpp.sim.masks import Degradation
from easyhecpp.sim.scenes import SimScene, random_scene
from easyhecpp.solve import Observation

SEED = 11
SMALL = {"width": 160, "height": 120, "focal": 130.0, "supersample": 3}

URDF = """<robot name="stick">
  <link name="base"><visual><geometry><cylinder radius="0.1" length="0.2"/></geometry></visual>
  </link>
  <link name="upper"><visual><origin xyz="0 0 0.3"/><geometry><box size="0.1 0.1 0.6"/></geometry>
  </visual></link>
  <link name="fore"><visual><origin xyz="0 0 0.2"/><geometry><box size="0.08 0.08 0.4"/></geometry>
  </visual></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0 0.65"/><axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
</robot>"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path: Path = tmp_path_factory.mktemp("robot") / "stick.urdf"
    path.write_text(URDF)
    return Robot.from_urdf(path)


class Oracle:
    """Returns the truth of the scene that the joints belong to, off by a known error."""

    def __init__(self, robot: Robot, n_scenes: int) -> None:
        self.scenes = [scene(robot, index) for index in range(n_scenes)]
        self.seen: list[tuple[int, list[np.ndarray], list[str]]] = []

    def __call__(self, rig: Rig, camera: Camera, observations: Sequence[Observation]) -> Outcome:
        index = next(
            i
            for i, s in enumerate(self.scenes)
            if (s.joints == observations[0].joints).all(1).any()
        )
        self.seen.append((index, [o.mask for o in observations], [o.id for o in observations]))
        truth = self.scenes[index].T_base_cam
        if index == 1 and len(observations) == 1:
            raise CalibrationError("the arm cannot be told from its mirror image")
        estimate = truth @ exp_se3(np.array([0.002, 0, 0, 0, 0, 0.001]))
        first = truth @ exp_se3(np.array([0.05, 0, 0, 0, 0, 0]))
        covariance = np.diag([1e-6] * 3 + [1e-6] * 3)
        return Outcome(first, estimate, covariance, 0.2, "converged", 0.5, 0.25)


def scene(robot: Robot, index: int) -> SimScene:
    return random_scene(robot, np.random.default_rng([SEED, index]), n_views=5, **SMALL)


NOISY = Degradation(iou=0.95, correlation_px=(3.0,))
FEW_CASES = (
    Case("exact"),
    Case("noisy", degradation=NOISY),
    Case("noisy, 1 view", 1, NOISY),
    Case("blob", degradation=NOISY, fault="blob"),
    Case("without the blob's view", 5, NOISY, "blob", leave_out_faulty=True),
    Case("no link", fault="missing link"),
    Case("holes", fault="holes"),
)


@pytest.fixture(scope="module")
def oracle(robot: Robot) -> Oracle:
    return Oracle(robot, 2)


def test_rows_tables_and_masks(robot: Robot, oracle: Oracle) -> None:
    done = []
    bench = run_solve_bench(
        robot,
        n_scenes=2,
        seed=SEED,
        cases=FEW_CASES,
        calibrate=oracle,
        progress=lambda n, _: done.append(n),
        **SMALL,
    )
    assert done == [1, 2]
    assert [row.case for row in bench.rows] == 2 * [case.name for case in FEW_CASES]

    # Errors against the truth that the benchmark itself knows.
    row = bench.rows[0]
    assert row.error is not None
    assert row.error.position_mm == pytest.approx(2.0, rel=1e-3)
    assert row.error.rotation_deg == pytest.approx(np.rad2deg(0.001), rel=1e-3)
    assert row.first_error is not None
    assert row.first_error.position_mm == pytest.approx(50.0)
    # (2 mm / 1 mm)^2 + (1 mrad / 1 mrad)^2
    assert row.chi_square == pytest.approx(5.0, rel=1e-2)
    failed = [row for row in bench.rows if row.error is None]
    assert [(row.scene, row.case) for row in failed] == [(1, "noisy, 1 view")]
    assert "mirror image" in failed[0].status

    masks = {case.name: seen for case, seen in zip(FEW_CASES, oracle.seen, strict=False)}
    truth = oracle.scenes[0].masks

    def iou(name: str, position: int, view: int) -> float:
        mask = masks[name][1][position]
        return float((mask & truth[view]).sum() / (mask | truth[view]).sum())

    np.testing.assert_array_equal(masks["exact"][1], truth)
    assert np.mean([iou("noisy", v, v) for v in range(5)]) == pytest.approx(0.95, abs=5e-3)
    np.testing.assert_array_equal(masks["noisy, 1 view"][1][0], masks["noisy"][1][0])
    assert masks["without the blob's view"][2] == ["1", "2", "3", "4"]
    np.testing.assert_array_equal(
        masks["without the blob's view"][1], masks["blob"][1][FAULTY_VIEW + 1 :]
    )
    blob = masks["blob"][1][FAULTY_VIEW]
    assert blob.sum() / truth[FAULTY_VIEW].sum() == pytest.approx(1.15, abs=0.05)
    missing, whole = masks["no link"][1][FAULTY_VIEW], truth[FAULTY_VIEW]
    assert not (missing & ~whole).any()
    assert missing.sum() < 0.97 * whole.sum()
    assert masks["holes"][1][FAULTY_VIEW].sum() < whole.sum()

    table = solve_table(bench)
    lines = {str(row[0]): row for row in table.rows}
    assert lines["noisy, 1 view"][2] == "1 of 2 (9-91 %)"
    assert lines["exact"][3] == pytest.approx(2.0, rel=1e-3)
    assert lines["without the blob's view"][1] == 4
    content = json.loads(table.to_json(**bench.record()))
    assert content["seed"] == SEED
    assert content["scene_options"] == SMALL
    assert len(content["all_rows"]) == len(bench.rows)


def test_any_scene_and_case_can_be_repeated_alone(robot: Robot) -> None:
    def masks_of(n_scenes: int, cases: tuple[Case, ...]) -> list[np.ndarray]:
        oracle = Oracle(robot, n_scenes)
        run_solve_bench(robot, n_scenes=n_scenes, seed=SEED, cases=cases, calibrate=oracle, **SMALL)
        return oracle.seen[-1][1]

    alone = masks_of(1, FEW_CASES[3:4])
    together = masks_of(1, FEW_CASES[:4])
    np.testing.assert_array_equal(alone, together)


def refuse(rig: Rig, camera: Camera, observations: Sequence[Observation]) -> Outcome:
    raise CalibrationError(f"{rig.robot.name} with {len(observations)} views")


def test_workers_give_the_same_rows_in_order(robot: Robot) -> None:
    cases = (Case("exact"), Case("exact, 2 views", 2))
    benches = [
        run_solve_bench(
            robot,
            n_scenes=3,
            seed=SEED,
            cases=cases,
            workers=workers,
            calibrate=refuse,
            **SMALL,
        )
        for workers in (1, 2)
    ]
    assert benches[0].rows == benches[1].rows
    assert [row.scene for row in benches[1].rows] == [0, 0, 1, 1, 2, 2]
    assert benches[1].rows[3].status == "stick with 2 views"


def test_stated_cases_have_names_of_their_own() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert CASES[1].noise_key == CASES[2].noise_key
    assert CASES[0].noise_key != CASES[1].noise_key
