"""Trials, policies, rulers, and one executed situation."""

import dataclasses
import math

import pytest
from refinement_fakes import LIBRARY, ROBOT, models

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.trials import Trial, open_places, random_trial, with_headings
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import ORDERS, POLICIES
from ator_ros.evaluation.toolset import Toolset
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

AT_ORIGIN = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))


def trial(index: int = 0, chain: str = "dribble") -> Trial:
    return random_trial(SOCCER, chain, LIBRARY, seed=403, index=index)


@pytest.fixture(scope="module")
def tools() -> Toolset:
    return Toolset(SOCCER, ROBOT, models())


def test_trials_depend_on_seed_and_index_only() -> None:
    assert trial(3) == trial(3)
    assert trial(3) != trial(4)
    assert trial(3) != random_trial(SOCCER, "dribble", LIBRARY, seed=404, index=3)


@pytest.mark.parametrize("chain", list(SOCCER.chains))
def test_trials_are_valid_plans_that_leave_only_headings_open(chain: str) -> None:
    for index in range(50):
        drawn = trial(index, chain)
        ready = with_headings(drawn.chain, dict.fromkeys(range(len(drawn.chain.calls) - 1), 0.3))
        assert ready.violations(drawn.world, ROBOT) == []
        assert [call.open for call in drawn.chain.calls[:-1]] == [frozenset({"yaw"})] * (
            len(ready.calls) - 1
        )
        assert not drawn.chain.calls[-1].open


@pytest.mark.parametrize("name", POLICIES)
def test_policies_choose_a_valid_chain_and_keep_commitments(name: str, tools: Toolset) -> None:
    for chain in SOCCER.chains:
        drawn = trial(1, chain)
        chosen = POLICIES[name](tools, drawn).chain
        opened = open_places(drawn.chain) if name.endswith("_place") else drawn.chain
        assert chosen.violations(drawn.world, ROBOT) == []
        for plan, call in zip(opened.calls, chosen.calls, strict=True):
            assert plan.opens("x") or call.goal.pose[:2] == plan.goal.pose[:2]
            if not name.endswith(("_speed", "_place")):
                assert call.goal.speed == 0.0


def test_face_goal_puts_the_ball_between_robot_and_goal(tools: Toolset) -> None:
    drawn = trial(2)
    chosen = POLICIES["face_goal"](tools, drawn).chain
    robot = chosen.calls[0].goal.robot_pose(ROBOT)
    ball, goal = chosen.calls[0].goal.pose, chosen.calls[1].goal.pose
    assert robot.distance(ball) + ball.distance(goal) == pytest.approx(robot.distance(goal))


def test_arrival_speed_is_refined_only_if_open(tools: Toolset) -> None:
    # The failure probability of the fakes grows with the speed; here a failure costs almost
    # nothing.
    without_cost = dataclasses.replace(
        tools, domain=dataclasses.replace(tools.domain, time_limit=0.1)
    )
    chains = [POLICIES["refined_speed"](without_cost, trial(index)).chain for index in range(5)]
    speeds = [chain.calls[0].goal.speed for chain in chains]
    assert max(speeds) > 0.2


def test_a_chain_moves_the_ball_to_its_goal_reproducibly() -> None:
    drawn = trial(5)
    to_ball = drawn.world.robot.pose.relative(drawn.chain.calls[0].goal.pose)
    chain = with_headings(
        drawn.chain, {0: drawn.world.robot.pose.yaw + math.atan2(to_ball.y, to_ball.x)}
    )
    runs = [run_chain(ROBOT, LIBRARY, drawn.world, chain) for _ in range(2)]
    assert runs[0] == runs[1]
    assert runs[0].success, runs[0].reason
    assert runs[0].duration == pytest.approx(sum(runs[0].actions))
    assert runs[0].error < 0.1


def test_a_failed_chain_counts_at_the_time_limit() -> None:
    drawn = trial(5)
    without_ball = dataclasses.replace(drawn.world, objects={})
    run = run_chain(ROBOT, LIBRARY, without_ball, with_headings(drawn.chain, {0: 0.0}))
    assert not run.success
    assert run.duration == TIME_LIMIT
    assert "pre-condition of goToBall" in run.reason


def test_orders_by_length_of_stations_in_a_line(tools: Toolset) -> None:
    """From 0, nearest next is 1, -2, 4.5: 10.5 m; the shortest order is -2, 1, 4.5: 8.5 m."""
    opened = frozenset({"yaw", "order"})
    top = LIBRARY["goToPose"]
    calls = tuple(TopCall(top, Goal(Pose(x, 0.0, 0.0)), opened) for x in (4.5, 1.0, -2.0))
    drawn = Trial(AT_ORIGIN, TopChain(calls))

    def places(name: str) -> list[float]:
        chosen = POLICIES[name](tools, drawn).chain
        return [call.goal.pose.x for call in chosen.calls]

    for headings in ("", "_refined"):
        assert places(f"listed{headings}") == [4.5, 1.0, -2.0]
        assert places(f"nearest{headings}") == [1.0, -2.0, 4.5]
        assert places(f"straight{headings}") == places(f"route{headings}") == [-2.0, 1.0, 4.5]
    refined = POLICIES["refined"](tools, drawn)
    assert refined.predicted is not None
    for name in ORDERS:
        assert refined.predicted.cost <= tools.predict(
            drawn.world, POLICIES[name](tools, drawn).chain
        ).cost + 0.05  # fmt: skip


def test_the_listed_round_with_headings_0_keeps_headings_that_are_not_open(tools: Toolset) -> None:
    top = LIBRARY["goToPose"]
    first, dock, last = (Goal(Pose(x, 0.0, 1.5)) for x in (4.5, 1.0, -2.0))
    opened = frozenset({"yaw", "order"})
    calls = (TopCall(top, first, opened), TopCall(top, dock), TopCall(top, last, opened))
    chosen = POLICIES["listed_fixed"](tools, Trial(AT_ORIGIN, TopChain(calls))).chain
    assert [call.goal.pose for call in chosen.calls] == [
        Pose(4.5, 0.0, 0.0),
        Pose(1.0, 0.0, 1.5),
        Pose(-2.0, 0.0, 0.0),
    ]
