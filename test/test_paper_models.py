"""The paper's candidate features and kind of situations, for the paper's actions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ator_ros.domains.soccer.ball import ball_of
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.quality.paper_models import at_rest
from ator_ros.robot.description import load_robot
from ator_ros.tools.paper_models import main


@pytest.mark.parametrize("action", ["goToPose", "dribbleBall"])
def test_situations_are_at_rest_with_the_ball_where_it_belongs(action: str) -> None:
    robot, rng = load_robot(), np.random.default_rng(1)
    for _ in range(20):
        drawn = at_rest(SOCCER.actions()[action].sample, robot, rng)
        assert ball_of(drawn) is not None
        assert (drawn.robot.v, drawn.robot.w, ball_of(drawn).speed, drawn.goal.speed) == (0.0, 0.0, 0.0, 0.0)
        place = drawn.goal.pose if action == "goToPose" else robot.hold_point(drawn.robot.pose)
        assert (ball_of(drawn).x, ball_of(drawn).y) == pytest.approx((place.x, place.y))


@pytest.mark.long
def test_table_tells_accuracy_beside_the_papers_and_the_rules(tmp_path: Path) -> None:
    out = tmp_path / "accuracy.md"
    assert main(["--episodes", "24", "--fresh", "20", "--jobs", "1", "--out", str(out)]) == 0
    text = out.read_text(encoding="utf-8")
    assert text.count("| goToPose |") == text.count("| dribbleBall |") == 4
    assert "0.31 / 0.75" in text
    assert "0.29 / 0.73" in text
    assert all("time = " in text.split(f"## Rules of {name}")[1] for name in ("goToPose", "dribbleBall"))
