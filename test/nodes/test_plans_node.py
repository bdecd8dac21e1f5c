"""Plans from goals over ROS: the service plan_chains, and the example that executes its response."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Start
from documentation import ROOT
from refinement_requests import save_small_models
from ros_client import Client

from ator_interfaces.msg import GoalTerm, ObjectState, PlanGoal
from ator_interfaces.srv import PlanChains
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of

pytestmark = pytest.mark.node


ROLLING = PlanGoal(terms=[GoalTerm(variable="ball.vx", value=1.0, low=-0.1, high=0.1)])
"""A goal that no TOP achieves."""


def request_of(goal: PlanGoal) -> PlanChains.Request:
    request = PlanChains.Request(goal=goal)
    request.situation.robot = pose_of(Pose(-2.0, 1.0, 0.0))
    request.situation.objects = [ObjectState(name="ball")]
    return request


def many(terms: int) -> PlanGoal:
    return PlanGoal(terms=[GoalTerm(variable="ball.x")] * terms)


def test_a_goal_is_planned_and_an_impossible_goal_is_rejected(
    start: Start, client: Client, tmp_path: Path
) -> None:
    save_small_models(tmp_path)
    start("refinement", models=tmp_path)

    def answered(goal: PlanGoal) -> PlanChains.Response:
        return client.call(PlanChains, "plan_chains", request_of(goal))

    planned = answered(PlanGoal(name="ball_in_goal"))
    assert planned.accepted, planned.reason
    steps = [[step.top for step in chain.calls] for chain in planned.chains]
    assert steps == [["goToBall", "dribbleBall", "shoot"]]
    assert list(planned.chains[0].calls[0].open) == ["speed", "yaw"]
    assert planned.chains[0].calls[0].goal.header.frame_id == "odom"
    assert answered(PlanGoal(terms=[GoalTerm(variable="ball.x", low=-1.0, high=1.0)])).holds
    for goal, reason in (
        (PlanGoal(name="ball_in_basket"), "goal.name: expected one of ['ball_held', 'ball_in_goal']"),
        (PlanGoal(), "goal.terms: expected 1 to 8 items, got 0"),
        (many(9), "goal.terms: expected 1 to 8 items, got 9"),
        (PlanGoal(terms=[GoalTerm(variable="cup.x")]), "goal.terms[0].variable: expected one of"),
        (ROLLING, "no TOP achieves ball.vx"),
        (PlanGoal(terms=[GoalTerm(variable="ball.x", low=1.0)]), "expected low <= high"),
        (PlanGoal(terms=[GoalTerm(variable="ball.x", value=float("nan"))]), "expected a finite number"),
    ):  # fmt: skip
        answer = answered(goal)
        assert not answer.accepted
        assert reason in answer.reason


def test_the_example_executes_the_best_of_the_planned_chains(
    start: Start, client: Client, domain: int, tmp_path: Path
) -> None:
    start("simulation", real_time_factor=4.0)
    save_small_models(tmp_path)
    start("refinement", models=tmp_path)
    start("executor", odom_timeout=5.0, start_timeout=60.0, refinement_timeout=30.0)
    client.place(robot=Pose(-1.2, 0.0, 0.0), ball=(0.0, 0.0))
    words = [sys.executable, str(ROOT / "examples" / "plan_and_execute.py"), "ball_held"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    ran = subprocess.run(words, capture_output=True, text=True, timeout=180.0, env=environment, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "executed: goToBall in " in ran.stdout
