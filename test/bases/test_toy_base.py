"""A base from outside the package drives, learns, refines and is stopped by the motion watch."""

import dataclasses
import itertools
import math
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from toy_base import GoStraight, PointRobot

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import Situation
from ator_ros.bases import description
from ator_ros.bases.description import ConfigError, load_robot
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.experience.simulated import run_episode
from ator_ros.experience.table import (
    Experience,
    join,
    read_experience,
    write_experience,
)
from ator_ros.geometry import Pose
from ator_ros.performance.features import (
    CANDIDATES,
    GENERAL,
    LATERAL,
    PAPER_3,
    feature_table,
    names_of,
    suited,
)
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.training import train
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, ObjectState, RobotState, World

ROBOT = PointRobot(
    name="point",
    front=0.1,
    rear=0.1,
    half_width=0.1,
    speed=0.5,
    scene=load_robot().scene,
)
THERE = Condition((Term("robot.x", "goal.x", 0.05), Term("robot.y", "goal.y", 0.05)))
GO = Top("go", "goStraight", Condition(), THERE)
EPISODES = 40


class PointWorld:
    """The simulation of a point."""

    def __init__(self, robot: PointRobot = ROBOT) -> None:
        self.robot = robot
        self.time = 0.0
        self._state = RobotState(Pose(0.0, 0.0, 0.0))
        self._command = STOP

    def world(self) -> World:
        return World(self.time, self._state)

    def place_robot(self, pose: Pose, velocity: Command = STOP) -> None:
        self._state = RobotState(pose, velocity.vx, vy=velocity.vy)

    def place_objects(self, objects: Mapping[str, ObjectState]) -> None:
        assert not objects

    def command(self, command: Command) -> None:
        self._command = command

    def tick(self) -> None:
        self._state = self.robot.moved(self._state, self._command, CONTROL_PERIOD)
        self.time += CONTROL_PERIOD


def episode_between(start: Pose, goal: Pose) -> pd.DataFrame:
    situation = Situation("goStraight", RobotState(start), {}, Goal(goal))
    episode = run_episode(PointWorld(), GoStraight(ROBOT), situation, top=GO)
    return episode.rows(0, ())


@pytest.fixture(scope="module")
def experience() -> pd.DataFrame:
    rng = np.random.default_rng(1)
    poses = [Pose(*rng.uniform(-3.0, 3.0, 2), rng.uniform(-3.0, 3.0)) for _ in range(EPISODES + 1)]
    pairs = itertools.pairwise(poses)
    return join(episode_between(*pair).assign(episode=number) for number, pair in enumerate(pairs))


@pytest.fixture(scope="module")
def model(experience: pd.DataFrame) -> PerformanceModel:
    return train("goStraight", experience, ROBOT)


def test_it_drives_sideways_with_its_heading_unchanged() -> None:
    rows = episode_between(Pose(0.0, 0.0, 0.0), Pose(0.0, 1.0, 0.0))
    assert rows["success"].all()
    assert rows["duration"].iloc[0] == pytest.approx(1.0 / ROBOT.speed, abs=2.0 * CONTROL_PERIOD)
    assert rows["vy"].iloc[1:].to_numpy() == pytest.approx(ROBOT.speed)
    assert rows["v"].abs().max() < 1e-9
    assert rows["yaw"].abs().max() == 0.0


def test_its_experience_is_read_as_written(experience: pd.DataFrame, tmp_path: Path) -> None:
    file = tmp_path / "experience.parquet"
    write_experience(file, Experience(experience, {"action_set": "default"}))
    assert read_experience(file).frame["vy"].to_numpy() == pytest.approx(experience["vy"])


def test_it_learns_that_only_the_distance_counts(model: PerformanceModel) -> None:
    places = np.array([[1.0, 0.0], [0.0, 2.0], [-2.0, -1.0]])
    direct = dict.fromkeys(("x", "y", "yaw", "v", "w", "yawg", "speedg", "hold"), 0.0)
    predicted = model.predict({**direct, "xg": places[:, 0], "yg": places[:, 1]}).duration
    assert predicted is not None
    assert predicted == pytest.approx(np.hypot(*places.T) / ROBOT.speed, abs=0.3)


def test_its_model_is_read_as_written(model: PerformanceModel, tmp_path: Path) -> None:
    file = tmp_path / "goStraight.json"
    save_model(file, model)
    again = load_model(file, ROBOT, GENERAL)
    assert again.driving == model.driving
    assert again.rules() == model.rules()


def test_an_open_place_is_refined_to_the_straight_line(model: PerformanceModel) -> None:
    via = TopCall(GO, Goal(Pose(1.5, 1.0, 0.0)), frozenset({"y"}))
    chain = TopChain((via, TopCall(GO, Goal(Pose(3.0, 0.0, 0.0)))))
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
    answer = Refiner(ROBOT, {"goStraight": model}).refine(world, chain)
    assert answer.refined
    assert answer.chain.calls[0].goal.pose.x == 1.5
    assert abs(answer.chain.calls[0].goal.pose.y) < 0.4
    assert answer.saved > 0.5


@pytest.mark.parametrize("command", [Command(0.4), Command(vy=0.4), Command(0.3, vy=-0.3)])
@pytest.mark.parametrize("moves", [True, False])
def test_the_motion_watch_stops_it_where_it_does_not_follow(command: Command, moves: bool) -> None:
    watch, simulation = MotionWatch(ROBOT, 0.0), PointWorld()
    faults = []
    for _ in range(40):
        state = simulation.world()
        faults.append(watch.fault(state.time, state.robot, state.time))
        watch.sent(state.time, command, state.time)
        if moves:
            simulation.command(command)
        simulation.tick()
    assert any(faults) is not moves


def test_a_description_selects_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "point.yaml"
    file.write_text(yaml.safe_dump(ROBOT.sections()), encoding="utf-8")
    with pytest.raises(
        ConfigError, match=r"robot\.drive: expected one of differential, omni, got 'point'"
    ):
        load_robot(file)
    entry = EntryPoint("point", "toy_base:PointRobot", description.GROUP)
    monkeypatch.setattr(description, "entry_points", lambda group: [entry])  # noqa: ARG005
    assert load_robot(file) == ROBOT
    assert load_robot(file).digest() != dataclasses.replace(ROBOT, speed=0.4).digest()


def test_it_never_exceeds_its_speed() -> None:
    for command in (Command(3.0, vy=4.0), Command(-9.0), Command(0.3, vy=0.1)):
        state = ROBOT.moved(RobotState(Pose(0.0, 0.0, 1.0)), command, 1.0)
        assert state.speed <= ROBOT.speed + 1e-12
        assert state.pose.distance(Pose(0.0, 0.0, 0.0)) == pytest.approx(state.speed)
        assert math.atan2(state.vy, state.vx) == pytest.approx(math.atan2(command.vy, command.vx))


def test_only_a_base_that_moves_sideways_has_features_of_that() -> None:
    lateral = {feature.name for feature in LATERAL}
    assert {*names_of(suited(CANDIDATES, ROBOT))} == {*names_of(CANDIDATES)} | lateral
    assert suited(CANDIDATES, load_robot()) == CANDIDATES
    assert suited(PAPER_3, ROBOT) == PAPER_3
    direct = dict.fromkeys(("x", "yaw", "v", "w", "xg", "yawg", "speedg", "hold"), np.zeros(2))
    direct |= {"y": np.zeros(2), "yg": np.array([1.0, -1.0]), "vy": np.array([0.2, 0.2])}
    assert feature_table(direct, ROBOT, LATERAL)[:, 0] == pytest.approx([0.2, -0.2])
