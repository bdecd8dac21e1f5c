"""The control law of the domain `pursuit`, and its durations compared with drives of Nav2."""

import csv
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from ator_ros.actions.base import Goal, Status
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.state import RobotState, World
from ator_ros_examples.pursuit import Pursuit, PursuitThrough
from ator_ros_examples.rotate_drive_rotate import Phase, State
from ator_ros_examples.stand_ins import PursuitStandIn

DOMAIN = find_domain("pursuit")
ROBOT = DOMAIN.robot()
DRIVES = Path(__file__).with_name("nav2_drives.csv")
"""Drives of Nav2 1.3.13 in an empty hall of 12 x 8 m (CC0)."""


def test_durations_agree_with_drives_of_nav2() -> None:
    errors = []
    with DRIVES.open(encoding="utf-8") as file, Simulation(ROBOT) as simulation:
        for row in csv.DictReader(file):
            start, goal = (
                Pose(*(float(row[f"{end}_{name}"]) for name in ("x", "y", "yaw")))
                for end in ("start", "goal")
            )
            place(simulation, World(0.0, RobotState(start)))
            before = simulation.time
            done = run_action(simulation, PursuitStandIn(ROBOT), Goal(goal))
            assert done.status is Status.SUCCEEDED
            assert simulation.world().robot.is_standing
            errors.append(simulation.time - before - float(row["duration_s"]))
    assert np.mean(np.abs(errors)) < 0.2


@pytest.mark.parametrize(
    ("angle", "drives"), [(44.0, True), (46.0, False), (-46.0, False), (170.0, False)]
)
def test_it_rotates_in_place_from_45_degrees_on(angle: float, drives: bool) -> None:
    law = Pursuit((2.0, 0.0, 0.0))
    v, w = law.step(State(0.0, 0.0, 0.0, math.radians(-angle)))
    assert (v > 0.2) is drives
    assert w * angle > 0.0
    law.step(State(0.05, 0.0, 0.0, math.radians(-30.0)))
    assert law.phase is (Phase.FOLLOWING if drives else Phase.ROTATING_TO_PATH)
    law.step(State(0.1, 0.0, 0.0, math.radians(-20.0)))
    assert law.phase is Phase.FOLLOWING


def test_it_slows_down_near_the_goal_and_in_sharp_curves() -> None:
    def speed(distance: float, yaw: float) -> float:
        return Pursuit((distance, 0.0, 0.0)).step(State(0.0, 0.0, 0.0, yaw))[0]

    assert speed(2.0, 0.0) == pytest.approx(0.6)
    assert speed(0.3, 0.0) == pytest.approx(0.3)
    assert 0.25 <= speed(2.0, 0.7) < 0.4


def test_it_arrives_within_both_tolerances_and_keeps_the_position() -> None:
    law = Pursuit((2.0, 0.0, 1.0))
    assert law.step(State(0.0, 1.84, 0.0, 0.0))[0] > 0.0
    assert law.step(State(0.05, 1.86, 0.0, 0.0)) == (0.0, pytest.approx(0.1))
    law.step(State(0.1, 1.80, 0.0, 0.84))
    assert law.phase is Phase.ROTATING_TO_GOAL
    assert law.step(State(0.15, 1.80, 0.0, 0.86)) == (0.0, 0.0)
    law.step(State(0.2, 1.80, 0.0, 0.9))
    assert law.phase is Phase.ARRIVED


def test_it_fails_if_the_robot_stays_where_it_is() -> None:
    law = Pursuit((2.0, 0.0, 0.0))
    for tick in range(202):
        command = law.step(State(0.05 * tick, 0.0, 0.0, 0.0))
    assert (law.phase, command) == (Phase.TOO_LONG, (0.0, 0.0))


def drive(
    law: Pursuit,
    start: tuple[float, float, float],
    newer: PursuitThrough | None = None,
    at: float = math.inf,
) -> np.ndarray:
    """Return the places (n, 2) of an ideal robot, every 0.05 s, until the law ends.

    A `newer` law takes over at the coordinate x `at` (m).
    """
    x, y, yaw = start
    v = 0.0
    places = []
    while law.phase is not Phase.ARRIVED:
        assert len(places) < 2000
        if newer is not None and x >= at:
            newer.take_over(law)
            law, newer = newer, None
        places.append((x, y))
        v, w = law.step(State(0.05 * len(places), x, y, yaw, v, 0.0))
        x += 0.05 * v * math.cos(yaw)
        y += 0.05 * v * math.sin(yaw)
        yaw += 0.05 * w
    return np.array(places)


def nearest(places: np.ndarray, pose: tuple[float, float, float]) -> float:
    return float(np.hypot(*(places - pose[:2]).T).min())


POSES = [(1.8, 0.0, 0.0), (3.5, 0.6, 0.0), (5.0, 1.0, 1.0)]


def test_it_drives_through_poses_without_a_stop_and_ends_at_the_last_one() -> None:
    places = drive(PursuitThrough(POSES), (0.0, 0.0, 0.0))
    assert all(nearest(places, pose) <= 0.3 for pose in POSES[:2])
    assert nearest(places, POSES[2]) <= 0.15
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert steps[: len(steps) // 2].min() > 0.2 * 0.05
    starts = [(0.0, 0.0, 0.0), *POSES]
    legs = [drive(Pursuit(goal), start) for start, goal in itertools.pairwise(starts)]
    assert len(places) < sum(map(len, legs))


def test_it_turns_back_to_a_pose_that_it_has_left_before_it_plans_again() -> None:
    """It plans after 1.8 m: 0.9 m beyond the first pose, or 0.1 m."""
    left, removed = (
        drive(PursuitThrough([(x, 0.0, 0.0), (6.0, 0.0, 0.0)]), (0.0, 0.0, 0.0)) for x in (0.9, 1.7)
    )
    assert np.diff(left[:, 0]).min() < -0.01
    assert np.diff(removed[:, 0]).min() >= 0.0


def test_it_does_not_turn_back_to_a_pose_that_a_newer_list_lacks() -> None:
    poses = [(0.9, 0.0, 0.0), (6.0, 0.0, 0.0)]
    places = drive(PursuitThrough(poses), (0.0, 0.0, 0.0), PursuitThrough(poses[1:]), at=0.7)
    assert np.diff(places[:, 0]).min() >= 0.0
    speeds = np.diff(places[:, 0]) / 0.05
    assert speeds[:80].min() > 0.5  # it drives on
