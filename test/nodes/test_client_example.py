"""The example client: its request is the README's, and the nodes refine and execute it."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from conftest import Start
from test_readme import README, ROOT, answered, printed

from ator_interfaces.srv import RefineSubgoal
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
    words = [sys.executable, str(ROOT / "examples" / "refine_and_execute.py")]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    ran = subprocess.run(words, capture_output=True, text=True, timeout=180.0, env=environment, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "refined: True" in ran.stdout
    assert "step 2 of 2, dribbleBall" in ran.stdout
    assert re.search(r"executed the refined chain in \d\.\d\d s: ", ran.stdout)
    assert re.search(
        r"step 1, goToBall: goal \(0\.00, 0\.00\), heading 16 deg, .* took \d\.\d\d s", ran.stdout
    )
    assert "refine: false" not in ran.stdout
