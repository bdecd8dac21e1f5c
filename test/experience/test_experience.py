"""Situations, episodes, parallel collection and the table."""

import functools
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from turning_action import TurnDriveTurn

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.situation import ActionSpec, Situation
from ator_ros.bases.description import Robot, load_robot
from ator_ros.bases.drive_parts import DriveParts
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.soccer.tops import GO_TO_BALL, GO_TO_POSE
from ator_ros.experience.repeats import without_repeats
from ator_ros.experience.simulated import collect, run_episode
from ator_ros.experience.table import (
    Episode,
    Experience,
    ExperienceError,
    columns,
    count_episodes,
    goal_variables_of_columns,
    join,
    objects_of_columns,
    read_experience,
    write_experience,
)
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.state import ObjectState, RobotState


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def frame(robot: Robot) -> pd.DataFrame:
    return join(collect([TURNING], SOCCER.tops, robot, objects=SOCCER.objects, episodes=6, seed=5))


TURNING = ActionSpec("goToPose", TurnDriveTurn, SOCCER.actions()["goToPose"].sample)


def plain(robot: Robot, goal: Pose) -> Situation:
    return Situation("goToPose", RobotState(Pose(0.0, 0.0, 0.0)), {}, Goal(goal))


to_pose = functools.partial(run_episode, top=GO_TO_POSE)


def test_episode_logs_at_10_hz_until_the_action_has_ended(robot: Robot) -> None:
    with Simulation(robot) as simulation:
        episode = to_pose(simulation, TurnDriveTurn(robot), plain(robot, Pose(1.0, 0.5, 1.0)))
    assert episode.success
    assert episode.position_error < 0.06
    assert episode.heading_error < 0.06
    assert np.diff(episode.samples[:, 0]) == pytest.approx(0.1)
    assert episode.duration - 0.1 - 1e-9 <= episode.samples[-1, 0] < episode.duration


def test_episode_ends_at_the_time_limit_as_a_failure(robot: Robot) -> None:
    with Simulation(robot) as simulation:
        episode = to_pose(
            simulation, TurnDriveTurn(robot), plain(robot, Pose(3.0, 0.0, 0.0)), time_limit=1.0
        )
    assert not episode.success
    assert episode.reason == "time limit of 1 s reached"
    assert episode.duration == pytest.approx(1.0)


def test_a_lost_ball_makes_an_arrival_a_failure(robot: Robot) -> None:
    goal = Goal(Pose(1.0, 0.0, math.pi), 0.0, Point.HOLD)  # straight through the ball
    situation = Situation(
        "goToPose", RobotState(Pose(-0.5, 0.0, 0.0)), {BALL: ObjectState(0.9, 0.0)}, goal
    )
    with Simulation(robot) as simulation:
        episode = run_episode(simulation, TurnDriveTurn(robot), situation, top=GO_TO_BALL)
    assert not episode.success
    assert "but post-condition of goToBall: expected hold.x within 0.1 of ball.x" in episode.reason


def test_table_is_unchanged_by_a_file(frame: pd.DataFrame, tmp_path: Path) -> None:
    file = tmp_path / "new" / "experience.parquet"
    write_experience(file, Experience(frame, {"seed": 5}))
    experience = read_experience(file)
    pd.testing.assert_frame_equal(
        experience.of("goToPose"),
        frame,
        check_exact=True,
        check_dtype=False,
        check_column_type=False,
    )
    assert experience.metadata["seed"] == 5
    assert [path.name for path in file.parent.iterdir()] == ["experience.parquet"]
    assert len(pd.read_parquet(file)) == len(frame)


def test_tables_of_earlier_versions_get_the_parts_of_their_drives(
    frame: pd.DataFrame, tmp_path: Path
) -> None:
    file, parts = tmp_path / "experience.parquet", list(DriveParts._fields)
    write_experience(file, Experience(frame.drop(columns=parts), {}))
    read = read_experience(file).frame
    assert read[parts].notna().any().all()
    pd.testing.assert_frame_equal(read[parts], frame[parts])
    # A collection that such a version began can be resumed.
    joined = join([frame.drop(columns=parts), frame])
    assert joined["driven"].notna().sum() == frame["driven"].notna().sum()


def test_foreign_and_newer_files_are_rejected(frame: pd.DataFrame, tmp_path: Path) -> None:
    file = tmp_path / "experience.parquet"
    frame.to_parquet(file)
    with pytest.raises(ExperienceError, match=r"metadata\.format: expected 'ator_ros experience'"):
        read_experience(file)
    write_experience(file, Experience(frame, {"schema_version": 99}))
    with pytest.raises(ExperienceError, match=r"metadata\.schema_version: expected 1, got 99"):
        read_experience(file)
    write_experience(file, Experience(frame.drop(columns="time_to_go"), {}))
    with pytest.raises(ExperienceError, match="missing: time_to_go"):
        read_experience(file)


def test_equal_episodes_count_once(frame: pd.DataFrame) -> None:
    later = frame.assign(episode=frame["episode"] + 6)
    other = later.assign(duration=later["duration"] + 1.0)
    rows = join([frame, later, other.assign(episode=other["episode"] + 6)])
    assert count_episodes(rows) == 18
    once = without_repeats(rows)
    assert sorted(once["episode"].unique()) == [*range(6), *range(12, 18)]
    assert without_repeats(rows.iloc[:0]).empty
    assert without_repeats(frame) is frame


def test_columns_name_objects_and_goal_variables() -> None:
    names = list(columns(("ball", "box"), ("force",)))
    assert names[:12] == [
        "action", "episode", "t", "x", "y", "yaw", "v", "w", "vy", "ball_x", "ball_y", "box_x",
    ]  # fmt: skip
    assert objects_of_columns([*names, "lone_x", "_x", "_y"]) == ("ball", "box")
    assert goal_variables_of_columns([*names, "g"]) == ("force",)
    assert len(names) == len({*names})


def test_a_join_of_nothing_has_the_columns_of_a_table() -> None:
    assert list(join([]).columns) == list(columns(()))


def test_an_episode_of_which_only_the_start_is_known_has_one_row() -> None:
    state = RobotState(Pose(1.0, 2.0, 0.5), 0.1, 0.2)
    goal = Goal(Pose(3.0, 4.0, 0.6), 0.3, Point.HOLD, {"force": 7.0})
    situation = Situation("push", state, {"box": ObjectState(5.0, 6.0)}, goal)
    episode = Episode(situation, 4.0, True, "done", 0.01, 0.02, parts=DriveParts(0.5, 0.6, 2.0))
    (row,) = episode.rows(3, ("ball", "box")).to_dict("records")
    assert math.isnan(row.pop("ball_x"))
    assert math.isnan(row.pop("ball_y"))
    assert math.isnan(row.pop("nearer"))
    assert row == {
        "action": "push", "episode": 3, "t": 0.0, "x": 1.0, "y": 2.0, "yaw": 0.5, "v": 0.1,
        "w": 0.2, "vy": 0.0, "box_x": 5.0, "box_y": 6.0, "xg": 3.0, "yg": 4.0, "yawg": 0.6,
        "speedg": 0.3, "forceg": 7.0, "hold": 1, "time_to_go": 4.0, "duration": 4.0,
        "success": True, "reason": "done", "first_turn": 0.5, "last_turn": 0.6, "driven": 2.0,
        "position_error": 0.01, "heading_error": 0.02,
    }  # fmt: skip


def test_the_parts_of_an_episode_follow_from_its_samples() -> None:
    """It turns for 1 s, drives 1 m in 2 s, and turns for 1 s."""
    times = np.arange(0.0, 4.0, 0.1)
    speeds = np.where((times >= 1.0) & (times < 3.0), 0.5, 0.0)
    samples = np.zeros((40, 7))
    samples[:, 0] = times
    samples[:, 4] = speeds
    situation = Situation(
        "goToPose", RobotState(Pose(0.0, 0.0, 0.0)), {}, Goal(Pose(1.0, 0.0, 0.0))
    )
    rows = Episode(situation, 4.0, True, "done", 0.0, 0.0, samples).rows(0, ())
    assert rows["time_to_go"].to_numpy() == pytest.approx(4.0 - times)
    assert rows["driven"].iloc[0] == pytest.approx(1.0)
    assert rows["first_turn"].iloc[0] == pytest.approx(1.15, abs=0.1)
    assert rows["last_turn"].iloc[0] == pytest.approx(1.1, abs=0.1)
