"""Figure 4: the situation it shows, and the command that draws it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from experience_rows import made_up_experience

from ator_ros.domains.soccer.figures import figure4
from ator_ros.performance.features import PAPER_3, feature_table
from ator_ros.performance.model_file import save_model
from ator_ros.performance.training import train
from ator_ros.robot.description import load_robot

ROBOT = load_robot()


@pytest.mark.parametrize("hold", [False, True])
def test_the_situation_is_the_papers(hold: bool) -> None:
    angles = np.radians(np.arange(-180.0, 180.0, 10.0))
    direct = figure4.situations(ROBOT, angles, hold=hold)
    dist, to_dest, at_dest = feature_table(direct, ROBOT, PAPER_3).T
    np.testing.assert_allclose(dist, 2.0)
    np.testing.assert_allclose(to_dest, 0.0, atol=1e-12)
    np.testing.assert_allclose(at_dest, np.abs(angles), atol=1e-12)


def test_the_command_draws_the_curve_and_prints_the_rule(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = train("goToPose", made_up_experience("goToPose"), ROBOT)
    save_model(tmp_path / "model.json", model)
    out = tmp_path / "figure4.svg"
    assert figure4.main(["--model", str(tmp_path / "model.json"), "--pose", "--out", str(out)]) == 0
    text = out.read_text()
    assert "angle_at_dest (degree)" in text
    assert "time =" in text
    printed = capsys.readouterr().out
    angle = np.array([math.radians(45.0)])
    expected = model.predict(figure4.situations(ROBOT, angle, hold=False)).duration
    assert expected is not None
    assert f"here time = {expected[0]:.3f}" in printed


def test_a_missing_model_is_said_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert figure4.main(["--model", str(tmp_path / "none.json")]) == 1
    assert capsys.readouterr().err.startswith("figure4: ")
