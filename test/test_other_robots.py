"""Robots unlike the Pioneer: the shipped descriptions, and what their actions and simulation need besides."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from robots import FIFTH, HEAVY, OTHERS, PIONEER, PLAIN, QUICK, SHIPPED

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Goal, Point, Status
from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.planned.dribble_ball import DribbleBall
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.domains.soccer.planned.shooting_room import has_room
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.trials import random_trial, with_headings
from ator_ros.experience.collect import EpisodeTask, episode_generator, run_task
from ator_ros.geometry import Pose
from ator_ros.nodes.simulation import robots_of
from ator_ros.robot.description import Limits, NoHolderError, Robot, load_robot
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.simulation import CONTROL_RATE, Simulation
from ator_ros.world.state import Command, ObjectState, RobotState, World

DOCS = Path(__file__).resolve().parents[1] / "docs" / "robots.md"
RACER = dataclasses.replace(
    PIONEER,
    name="racer",
    limits=Limits(v=2.5, w=6.0, a=2.0, brake=2.0, aw=12.0),
    holder=dataclasses.replace(
        PIONEER.holder_for("a test"), limits=Limits(v=2.0, w=2.0, a=1.5, brake=1.2, aw=6.0)
    ),
)
"""Its limits are more than wheels and ball can do at once."""


def succeeds(action: str, robot: Robot, episode: int, *, seed: int = 1) -> bool:
    spec = SOCCER.actions()[action]
    rows = run_task(EpisodeTask(spec, SOCCER.tops, robot, seed, episode, SOCCER.objects))
    return bool(rows["success"].iloc[-1])


def test_the_shipped_robots_differ_as_the_documentation_says() -> None:
    text = DOCS.read_text(encoding="utf-8")
    assert all(f"config/{file.name}" in text for file in SHIPPED)
    lags = [robot.motor_time_constant for robot in (QUICK, PIONEER, PLAIN, HEAVY)]
    assert lags == sorted(lags)
    assert (lags[0], lags[-1]) == (0.02, 0.15)
    assert 0.3 <= PLAIN.limits.v <= 0.5
    assert [robot.holder is None for robot in (PIONEER, PLAIN, HEAVY, QUICK)] == [False, True, False, False]
    assert len({robot.digest() for robot in (PIONEER, PLAIN, *OTHERS)}) == 6


def test_without_a_holder_there_is_a_chain_but_no_dribble() -> None:
    with pytest.raises(NoHolderError, match="dribbleBall needs a holder; robot turtlebot4 has none"):
        SOCCER.actions()["dribbleBall"].factory(PLAIN)
    world, chain = SOCCER.chains["drive"](PLAIN, SOCCER.library(PLAIN), np.random.default_rng(1))
    assert [call.top.name for call in chain.calls] == ["goToPose", "goToPose"]
    assert not world.objects


def test_who_cannot_arrive_so_fast_arrives_slower() -> None:
    """A heavy robot so near the ball has no room to gain 0.8 m/s before a run into the catch."""
    world = World(0.0, RobotState(Pose(-1.4444, 0.9029, -0.4806)), {BALL: ObjectState(-2.3877, 1.5912)})
    goal = Goal(Pose(-2.3877, 1.5912, 0.4312), 0.8, Point.HOLD)
    with Simulation(HEAVY) as simulation:
        place(simulation, world)
        done = run_action(simulation, GoToPose(HEAVY), goal)
        assert done.status is Status.SUCCEEDED
        assert 0.2 < simulation.world().robot.v < 0.75
        assert 0.2 < done.command.v < 0.75


@pytest.mark.parametrize("robot", [PIONEER, PLAIN, HEAVY, QUICK, FIFTH], ids=lambda robot: robot.name)
def test_the_simulated_base_lags_as_it_is_described(robot: Robot) -> None:
    gain, ticks = 0.9 * robot.limits.a, 10
    assert gain * ticks / CONTROL_RATE < robot.limits.v
    with Simulation(robot) as simulation:
        place(simulation, World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {}))
        for tick in range(1, ticks + 1):
            simulation.command(Command(gain * tick / CONTROL_RATE, 0.0))
            simulation.tick()
        behind = ticks / CONTROL_RATE - simulation.world().robot.v / gain
    assert behind == pytest.approx(robot.motor_time_constant, abs=0.015)


def test_a_weak_robot_follows_its_plan() -> None:
    spec, worst = SOCCER.actions()["goToPose"], 0.0
    for episode in (5, 84):
        drawn = spec.sample(HEAVY, episode_generator(spec.name, 1, episode))
        with Simulation(HEAVY) as simulation:
            place(simulation, World(0.0, drawn.robot, drawn.objects))
            action = GoToPose(HEAVY)
            done = run_action(simulation, action, drawn.goal)
            assert done.status is Status.SUCCEEDED
            worst = max(worst, simulation.time)
    assert worst < TIME_LIMIT


def test_plans_turn_no_faster_than_wheels_grip() -> None:
    for robot in (PIONEER, *OTHERS, RACER):
        for action in (GoToPose(robot), DribbleBall(robot)):
            limits = action.plan_limits
            assert limits.v * limits.w <= 4.0 + 1e-9
    assert GoToPose(PIONEER).plan_limits.w == 0.97 * PIONEER.limits.w
    assert DribbleBall(RACER).plan_limits.brake == pytest.approx(0.65)


def test_shots_without_room_are_not_drawn() -> None:
    without = situations.shoot(FIFTH, episode_generator("shoot", 1, 3))
    assert not has_room(FIFTH, without)
    drawn = SOCCER.actions()["shoot"].sample(FIFTH, episode_generator("shoot", 1, 3))
    assert has_room(FIFTH, drawn)
    same = SOCCER.actions()["shoot"].sample(PIONEER, episode_generator("shoot", 1, 4))
    assert same == situations.shoot(PIONEER, episode_generator("shoot", 1, 4))


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_nodes_take_each_file_and_a_naive_chain_succeeds(file: Path) -> None:
    (robot,) = robots_of({"domain": "soccer", "robot": str(file), "robots": [""], "descriptions": [""]})
    assert robot == load_robot(file)
    library = SOCCER.library(robot)
    trial = random_trial(SOCCER, "dribble" if robot.holder else "drive", library, seed=3, index=0)
    start, first = trial.world.robot.pose, trial.chain.calls[0].goal.pose
    chain = with_headings(trial.chain, {0: math.atan2(first.y - start.y, first.x - start.x)})
    done = run_chain(robot, library, trial.world, chain)
    assert done.success, done.reason


def test_a_weak_robot_that_catches_up_with_its_plan_does_not_run_past_the_goal() -> None:
    """Its brake is hardly stronger than what the ball allows, and to back off would leave the ball behind."""
    pose = Pose(-2.25, 1.3, -2.3)
    goal = Goal(Pose(-2.42, -0.72, -1.63), 0.0, Point.HOLD)
    held = HEAVY.hold_point(pose)
    with Simulation(HEAVY) as simulation:
        place(simulation, World(0.0, RobotState(pose), {BALL: ObjectState(held.x, held.y)}))
        done = run_action(simulation, DribbleBall(HEAVY), goal)
        assert done.status is Status.SUCCEEDED
        assert simulation.time < 6.0


def test_a_dribble_that_begins_fast_is_planned_without_a_stop() -> None:
    """Beside a goal the search takes longer than a tick; to stop for it, the weak robot lost 4 s."""
    pose, speed = Pose(2.59, 0.66, -1.56), 0.8
    action, held = DribbleBall(HEAVY), HEAVY.hold_point(pose)
    start = World(0.0, RobotState(pose, speed), {BALL: ObjectState(held.x, held.y)})
    action.start(start, Goal(Pose(-2.84, -1.27, -0.23), 0.0, Point.HOLD))
    assert action.planning
    tick = 0
    while action.planning:
        tick += 1
        pose = start.robot.pose.ahead(0.05 * tick * speed)
        held = HEAVY.hold_point(pose)
        ball = {BALL: ObjectState(held.x, held.y)}
        step = action.step(World(0.05 * tick, RobotState(pose, speed), ball))
        assert step.command is not None
        assert step.command.v > 0.99 * speed
    assert 1 <= tick <= 7
    way = action.way()
    assert way is not None
    assert np.hypot(*(way[0, :2] - start.robot.pose[:2])) < 0.01


def test_a_short_quick_robot_does_not_tip_over_in_turns_that_its_wheels_hold() -> None:
    limits = Limits(v=1.5, w=3.5, a=1.3, brake=1.3, aw=7.0)
    robot = dataclasses.replace(
        FIFTH, name="quick", track=0.24, mass=5.0, front=0.14, rear=0.14, half_width=0.15, wheel_radius=0.06,
        wheel_torque=2.5, motor_time_constant=0.04, limits=limits,
    )  # fmt: skip
    turn = GoToPose(robot).plan_limits
    with Simulation(robot) as simulation:
        for tick in range(3 * CONTROL_RATE):
            now = tick / CONTROL_RATE
            simulation.command(Command(min(limits.a * now, turn.v), turn.w if now > 1.5 else 0.0))
            simulation.tick()
        state = simulation.world().robot
    assert (state.v, state.w) == pytest.approx((turn.v, turn.w), rel=0.05)
