"""Figures 4 and 6: the situations that they show, and the script that draws them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ator_ros.performance.features import PAPER_3, feature_table
from ator_ros.robot.description import load_robot
from scripts import figures

ROBOT = load_robot()


def test_the_situation_of_figure_4_is_the_papers() -> None:
    angles = np.radians(np.arange(-180.0, 180.0, 10.0))
    dist, to_dest, at_dest = feature_table(figures.situations(ROBOT, angles), ROBOT, PAPER_3).T
    np.testing.assert_allclose(dist, 2.0)
    np.testing.assert_allclose(to_dest, 0.0, atol=1e-12)
    np.testing.assert_allclose(at_dest, np.abs(angles), atol=1e-12)


def test_both_figures_are_drawn(tmp_path: Path) -> None:
    assert figures.main(["--action-set", "bezier", "--out", str(tmp_path)]) == 0
    assert "angle_at_dest (degree)" in (tmp_path / "figure4_bezier.svg").read_text()
    assert "together" in (tmp_path / "figure6_bezier.svg").read_text()
