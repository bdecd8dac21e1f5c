"""The example clients: the request of one is the README's; they refine, plan and execute chains."""

import re
import sys
from pathlib import Path

import pytest
from conftest import Start
from process import run
from refinement_requests import save_small_models
from ros_client import Client
from test_readme import README, ROOT, answered, printed

from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from examples.call import filled
from examples.refine_and_execute import request


def test_its_request_has_the_answer_of_the_readme() -> None:
    theirs = answered(filled(RefineSubgoal.Request, printed("ros2 service call /refine_subgoal")))
    answer = answered(request())
    assert answer.accepted
    assert answer.refined
    assert answer.reason == theirs.reason
    assert answer.reason in README
    assert answer.free == theirs.free


@pytest.mark.long
def test_it_drives_the_simulated_robot(start: Start, domain: int) -> None:
    for name in ("simulation", "refinement", "executor"):
        start(name, **({"real_time_factor": 3.0} if name == "simulation" else {}))
    ran = run(sys.executable, str(ROOT / "examples" / "refine_and_execute.py"), domain=domain)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "refined: True" in ran.stdout
    assert "step 2 of 2, dribbleBall" in ran.stdout
    assert re.search(r"executed the refined chain in \d\.\d\d s: ", ran.stdout)
    assert re.search(
        r"step 1, goToBall: goal \(0\.00, 0\.00\), heading 16 deg, .* took \d\.\d\d s", ran.stdout
    )
    assert "refine: false" not in ran.stdout


@pytest.mark.long
def test_the_example_executes_the_best_of_the_planned_chains(
    start: Start, client: Client, domain: int, tmp_path: Path
) -> None:
    start("simulation", real_time_factor=4.0)
    save_small_models(tmp_path)
    start("refinement", models=tmp_path)
    start("executor", odom_timeout=5.0, start_timeout=60.0, refinement_timeout=30.0)
    client.place(robot=Pose(-1.2, 0.0, 0.0), ball=(0.0, 0.0))
    script = str(ROOT / "examples" / "plan_and_execute.py")
    ran = run(sys.executable, script, "ball_held", domain=domain)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "executed: goToBall in " in ran.stdout
