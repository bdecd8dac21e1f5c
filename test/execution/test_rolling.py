"""Rolling balls: where they come to rest, and chains refined during execution."""

from __future__ import annotations

import dataclasses

import pytest
from refined_along import Along, RefinedAlong

from ator_ros.actions.base import ActionError
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.planned.holding import DribbleBall
from ator_ros.evaluation.chain_run import ChainRun, run_chain
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, make_library, make_toolset
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.robot.description import load_robot
from ator_ros.tops.objects import at_rest

SOURCE = ToolsetSource()
SEED = 453


@pytest.fixture(scope="module")
def tools() -> Toolset:
    return make_toolset(SOURCE)


def trial(tools: Toolset, index: int) -> Trial:
    return random_trial(SOCCER, "rolling", make_library(tools.robot, SOURCE), seed=SEED, index=index)


def test_the_plan_uses_the_start_place_and_the_ball_rests_before_the_robot_arrives(
    tools: Toolset,
) -> None:
    for index in range(50):
        drawn = trial(tools, index)
        ball, goal = drawn.world.objects[BALL], drawn.chain.calls[0].goal.pose
        assert not drawn.chain.violations(drawn.world, tools.robot)
        assert (ball.x, ball.y) == goal[:2]
        assert 0.5 <= ball.speed <= 2.5
        rest = at_rest(drawn.world, tools.robot).objects[BALL]
        there = goal._replace(x=rest.x, y=rest.y)
        rolling = 2.0 * goal.distance(there) / ball.speed
        assert rolling <= drawn.world.robot.pose.distance(there) / tools.robot.limits.v


def test_questions_change_the_chain_and_disabled_ones_do_not(
    tools: Toolset,
) -> None:
    drawn, library = trial(tools, 1), make_library(tools.robot, SOURCE)
    choice = POLICIES["refined_speed"](tools, drawn)
    assert choice.refinement is not None
    along = Along((choice.refinement.original,), tools.refiner(gated=True))

    def run(along: Along) -> tuple[ChainRun, int]:
        executor = RefinedAlong(library, choice.chain, along, time_limit=SOCCER.time_limit)
        done = run_chain(tools.robot, library, drawn.world, choice.chain, executor=executor)
        return done, executor.again

    once = run_chain(tools.robot, library, drawn.world, choice.chain)
    never, _ = run(dataclasses.replace(along, again_after=0.0))
    assert dataclasses.replace(never, reason=once.reason) == once
    again, changes = run(along)
    assert again.success
    assert changes >= 1


def test_a_ball_that_is_lost_in_every_turn_cannot_be_dribbled() -> None:
    robot = load_robot()
    ball = dataclasses.replace(robot.scene.objects["ball"], rolling_deceleration=0.03)
    scene = dataclasses.replace(robot.scene, objects={"ball": ball})
    with pytest.raises(ActionError, match="ball stays in front"):
        DribbleBall(dataclasses.replace(robot, scene=scene)).setup()
