"""States that come late, carried on to the moment at which their answer moves the base."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from ator_ros.actions.base import Goal, Point, Status
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.trials import random_trial, with_headings
from ator_ros.geometry import Pose
from ator_ros.robot.description import load_robot
from ator_ros.robot.response import Foresight
from ator_ros.simulation.sensors import SensorConfig, Sensors
from ator_ros.simulation.simulation import TICK, Simulation
from ator_ros.world.state import STOP, Command, ObjectState, RobotState, World

ROBOT = load_robot()
STANDING = RobotState(Pose(0.0, 0.0, 0.0))


def test_who_was_told_nothing_goes_on_as_he_does_and_the_ball_rolls_on() -> None:
    world = World(
        1.0, RobotState(Pose(1.0, 2.0, np.pi / 2), 0.5, 0.0), {BALL: ObjectState(1.0, 1.0, 0.2, -0.1)}
    )
    ahead = Foresight(ROBOT, 0.2).ahead(world)
    assert ahead.time == pytest.approx(1.2)
    assert ahead.robot.pose == pytest.approx((1.0, 2.1, np.pi / 2))
    assert (ahead.robot.v, ahead.robot.w) == (0.5, 0.0)
    assert ball_of(ahead) == ObjectState(pytest.approx(1.04), pytest.approx(0.98), 0.2, -0.1)


def test_a_base_keeps_to_its_limits() -> None:
    foresight = Foresight(ROBOT, 0.2)
    foresight.sent(0.8, Command(1.2, -2.4))
    ahead = foresight.ahead(World(1.0, STANDING)).robot
    assert (ahead.v, ahead.w) == pytest.approx((0.2 * ROBOT.limits.a, -0.2 * ROBOT.limits.aw))


def test_a_command_acts_only_after_the_latency() -> None:
    foresight = Foresight(ROBOT, 0.2)
    foresight.sent(0.8, STOP)
    foresight.sent(0.9, Command(1.0, 0.0))
    ahead = foresight.ahead(World(1.0, STANDING)).robot
    assert ahead.v == pytest.approx(0.1 * ROBOT.limits.a)


def test_what_was_told_long_ago_or_before_a_reset_counts_no_more() -> None:
    moving = World(3.0, RobotState(Pose(0.0, 0.0, 0.0), 0.5))
    foresight = Foresight(ROBOT, 0.1)
    foresight.sent(2.0, STOP)
    assert foresight.ahead(moving).robot.v == 0.5
    foresight.sent(2.9, STOP)
    assert foresight.ahead(moving).robot.v < 0.5
    foresight.reset()
    assert foresight.ahead(moving).robot.v == 0.5


def stepped(value: float, goal: float, acceleration: float) -> float:
    """Return a velocity that goes toward `goal` for a tick."""
    return value + float(np.clip(goal - value, -acceleration * TICK, acceleration * TICK))


@pytest.mark.parametrize("ticks", [1, 2, 4])
def test_it_foresees_what_the_simulated_base_does(ticks: int) -> None:
    rng, limits = np.random.default_rng(5), ROBOT.limits
    foresight, seen, worst = Foresight(ROBOT, ticks * TICK), deque[World](maxlen=ticks + 1), np.zeros(2)
    command = STOP
    with Simulation(ROBOT) as simulation:
        for tick in range(200):
            if tick % 20 == 0:
                goal = Command(*rng.uniform((-0.8, -1.5), (0.8, 1.5)))
            seen.append(simulation.world())
            if len(seen) > ticks:
                foreseen = foresight.ahead(seen[0])
                assert foreseen.time == pytest.approx(seen[-1].time)
                off = seen[-1].robot.pose.relative(foreseen.robot.pose)
                worst = np.maximum(worst, np.abs((np.hypot(off.x, off.y), off.yaw)))
            command = Command(stepped(command.v, goal.v, limits.a), stepped(command.w, goal.w, limits.aw))
            if tick % 50 > 40:  # a stop, harder than any plan's
                command = STOP
            foresight.sent(seen[0].time, command)
            simulation.command(command)
            simulation.tick()
    assert worst[0] < 0.008 * ticks  # the lag of the motors is not foreseen
    assert worst[1] < 0.02 * ticks


def approach(ticks: int, *, late: int, held_back: bool) -> tuple[float, float]:
    """Drive to a ball; give the time that takes in s and how far the ball was moved in m.

    States come `ticks` late, and the first answer `late` ticks after that, as where planning takes time.
    """
    foresight, seen = Foresight(ROBOT, ticks * TICK), deque[World](maxlen=ticks + 1)
    action = GoToPose(ROBOT)
    with Simulation(ROBOT) as simulation:
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))
        simulation.place_object(BALL, 0.0, 0.0)
        began = False
        while simulation.time < 20.0:
            seen.append(simulation.world())
            if len(seen) > ticks:
                world = foresight.ahead(seen[0])
                if not began:
                    action.start(world, Goal(Pose(0.0, 0.0, 0.0), 0.0, Point.HOLD))
                step = action.step(world)
                if step.status is not Status.RUNNING:
                    break
                took = 0.001 if began else late * TICK
                for _ in range(0 if began else late):
                    simulation.tick()
                    seen.append(simulation.world())
                began = True
                command = foresight.punctual(world.robot, step.command, took if held_back else 0.0)
                foresight.sent(world.time - ticks * TICK, command)
                simulation.command(command)
            simulation.tick()
        ball = ball_of(simulation.world())
    assert ball is not None
    return simulation.time, float(np.hypot(ball.x, ball.y))


@pytest.mark.parametrize(("ticks", "late"), [(1, 1), (1, 6), (2, 2), (4, 1), (4, 6)])
def test_planning_that_takes_its_time_does_not_make_the_robot_push_the_ball(ticks: int, late: int) -> None:
    punctual, _ = approach(ticks, late=0, held_back=True)
    duration, moved = approach(ticks, late=late, held_back=True)
    assert moved < 0.01
    assert duration <= punctual + (late + 2) * TICK


def test_only_a_robot_that_stands_is_held_back() -> None:
    go, moving = Command(0.1, 0.0), RobotState(Pose(0.0, 0.0, 0.0), 0.3)
    assert Foresight(ROBOT, 0.1).punctual(STANDING, go, 0.001) == go
    assert Foresight(ROBOT, 0.1).punctual(STANDING, go, 0.1) == STOP
    assert Foresight(ROBOT, 0.1).punctual(moving, go, 0.1) == go
    assert Foresight(ROBOT, 0.0).punctual(STANDING, go, 0.1) == go


def test_who_is_always_late_is_held_back_every_other_time_only() -> None:
    foresight, go = Foresight(ROBOT, 0.1), Command(0.1, 0.0)
    answers = [foresight.punctual(STANDING, go, 0.1) for _ in range(4)]
    assert answers == [STOP, go, STOP, go]


@pytest.mark.parametrize("index", range(2))
def test_a_chain_takes_the_same_time_though_its_states_come_late(index: int) -> None:
    latency, library = 0.15, SOCCER.library(ROBOT)
    trial = random_trial(SOCCER, "dribble", library, seed=614, index=index)
    chain = with_headings(trial.chain, {0: trial.chain.calls[1].goal.pose.yaw})

    def run(*, late: float, foreseen: float) -> float:
        sensors = Sensors(SensorConfig(latency=late))
        return run_chain(
            ROBOT, library, trial.world, chain, observe=sensors.observe, latency=foreseen
        ).duration

    punctual = run(late=0.0, foreseen=0.0)
    # The robot begins later by the latency; the end is foreseen.
    assert run(late=latency, foreseen=latency) <= punctual + latency + 1.5 * TICK
    assert run(late=latency, foreseen=0.0) > punctual + 1.0
