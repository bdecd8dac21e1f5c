"""The README's requests are valid as printed, and its answer is that of the shipped models."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from ator_interfaces.action import ExecuteChain
from ator_interfaces.srv import RefineSubgoal
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.nodes.messages import answer_of, chain_from, gain_of
from ator_ros.nodes.refinement import refine_request
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.refiner import Refiner
from examples.call import filled

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)


def printed(command: str) -> dict[str, Any]:
    """Return the message in the README's line `command`."""
    found = re.search(rf'{command}.*?"(\{{.*?\}})"', README, re.DOTALL)
    values: dict[str, Any] = yaml.safe_load(found.group(1))
    return values


def answered(request: RefineSubgoal.Request) -> RefineSubgoal.Response:
    models = load_models(ROBOT, SOCCER.known_features)
    refiner = Refiner(ROBOT, models, Gate(), ranges=SOCCER.ranges)
    found = refine_request(request, refiner, LIBRARY, frame="odom")
    reason = found.refinement.reason
    return answer_of(found, request, gain_of(), reason=reason, action_set="default", frame="odom")


def durations(field: str) -> list[str]:
    """Return the durations in a field of the README's answer."""
    found = re.search(rf"\b{field}=\[?(Performance\(.*?)(?:, after=|\]|,?\n)", README)
    return re.findall(r"duration=([\d.]+)", found.group(1))


def test_the_printed_answer_matches_the_response() -> None:
    answer = answered(filled(RefineSubgoal.Request, printed("ros2 service call /refine_subgoal")))
    assert answer.accepted
    assert f'refined={answer.refined}, reason="{answer.reason}"' in README
    approach = answer.chain.calls[0].goal.pose.orientation
    assert f"orientation=Quaternion(z={approach.z:.4f}, w={approach.w:.4f})" in README
    (free,) = answer.free
    assert f"name='{free.name}', before={free.before:.4f}, after={free.after:.4f}" in README
    assert durations("before") == [f"{answer.before.duration:.2f}"]
    assert durations("after") == [f"{answer.after.duration:.2f}"]
    assert durations("before_actions") == [
        f"{action.duration:.2f}" for action in answer.before_actions
    ]
    assert durations("after_actions") == [
        f"{action.duration:.2f}" for action in answer.after_actions
    ]


def test_an_open_speed_has_the_documented_gain() -> None:
    request = filled(RefineSubgoal.Request, printed("ros2 service call /refine_subgoal"))
    request.chain.calls[0].open = ["yaw", "speed"]
    answer = answered(request)
    stated = re.search(
        r"along at ([\d.]+) m/s and the chain is predicted to take ([\d.]+) s", README
    )
    assert float(stated.group(1)) == pytest.approx(answer.chain.calls[0].speed, abs=0.05)
    assert stated.group(2) == f"{answer.after.duration:.2f}"


def test_the_printed_goal_is_the_same_chain() -> None:
    goal = filled(ExecuteChain.Goal, printed("ros2 action send_goal --feedback /execute_chain"))
    request = filled(RefineSubgoal.Request, printed("ros2 service call /refine_subgoal"))
    assert goal.refine
    assert goal.chain == request.chain
    assert [call.top.name for call in chain_from(goal.chain, LIBRARY, frame="odom").calls] == [
        "goToBall",
        "dribbleBall",
    ]
