"""The services that refine_subgoal is measured beside, without ROS between."""

from __future__ import annotations

from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.evaluation.trials import random_trial
from ator_ros.nodes.messages import chain_of, situation_of
from ator_ros.robot.description import load_robot
from ator_ros.tools.benchmarks.service import YARDSTICKS

SOURCE = ToolsetSource()


def request(index: int) -> RefineSubgoal.Request:
    robot = load_robot()
    trial = random_trial(SOCCER, "dribble", SOCCER.library(robot), seed=802, index=index)
    return RefineSubgoal.Request(
        situation=situation_of(trial.world, frame="odom"),
        chain=chain_of(trial.chain, action_set="", frame="odom"),
    )


def test_the_empty_service_answers_with_nothing() -> None:
    nothing = RefineSubgoal.Response()
    assert YARDSTICKS["empty"](SOURCE)(request(0), nothing) is nothing
    assert nothing == RefineSubgoal.Response()


def test_messages_alone_are_full_answers_that_are_refined_once() -> None:
    answer = YARDSTICKS["messages_alone"](SOURCE)
    first, second = (answer(request(index), RefineSubgoal.Response()) for index in range(2))
    assert first.accepted
    assert len(first.chain.calls) == len(first.after_actions) == 2
    assert first.after.duration > 0.0
    assert second.chain == first.chain
