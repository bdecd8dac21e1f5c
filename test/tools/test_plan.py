"""The tool `plan`: chains for a goal, with predicted durations."""

import pytest

from ator_ros.tools.plan import main as plan_main


def test_the_tool_prints_chains_and_predictions(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("ball_in_goal", "--at", "3.4", "1", "3.14", "--object", "ball", "2.4", "0.5")
    assert plan_main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    durations = [float(line.split()[0]) for line in lines]
    assert durations == sorted(durations)
    assert plan_main([]) == 0
    assert "ball_in_goal" in capsys.readouterr().out
    assert plan_main(["ball_in_goal"]) == 1
    refused = capsys.readouterr().err
    assert refused.startswith("plan: goToBall needs the ball, which is unknown; ")
    assert "no TOP achieves ball.x " in refused
    assert refused.count("\n") == 1
