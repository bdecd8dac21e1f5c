"""Evaluations and reports of other domains: drawn and worded without soccer."""

from __future__ import annotations

import dataclasses
import json
import re
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experience_rows import made_up_experience
from parcels import PARCELS

from ator_ros.domains import domain as domains
from ator_ros.domains.presentation import Presentation
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.performance.model_file import save_model
from ator_ros.performance.training import train
from ator_ros.report import charts
from ator_ros.robot.description import Robot, load_robot
from ator_ros.tools import evaluate

ROBOT = load_robot()
WORDS = r"\b(balls?|goToBall|goToPose|dribble\w*|shoot|soccer|533)\b"
DRAWN: list[Robot] = []


def draw(axes: Any, robot: Robot) -> None:
    """Draw a shelf, and keep in mind that it was drawn."""
    axes.plot([0.0, 1.0], [2.0, 2.0])
    DRAWN.append(robot)


SHELVES = dataclasses.replace(
    PARCELS,
    name="shelves",
    presentation=Presentation(draw=draw, place="shelf", chains={"one_leg": "go there"}),
)


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    names = {"parcels": "parcels:PARCELS", "shelves": "test_report_domains:SHELVES"}
    entries = [EntryPoint(name, value, domains.GROUP) for name, value in names.items()]
    monkeypatch.setattr(domains, "entry_points", lambda **_: entries)


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    save_model(folder / "carry.json", train("carry", made_up_experience("carry"), PARCELS.robot()))
    return folder


def evaluated(models: Path, out: Path, domain: str, *words: str) -> tuple[dict[str, Any], str]:
    """Return the result and the report of two situations."""
    place = ["--models", str(models), "--out", str(out), "--jobs", "1", "--seed", "405"]
    policies = ["--policies", "naive", "bearing", "face_goal", "refined", "--situations", "2"]
    assert evaluate.main(["--domain", domain, *place, *policies, *words]) == 0
    result = json.loads((out / "evaluation.json").read_text())
    return result, (out / "report.html").read_text()


def test_a_report_of_another_domain_has_no_words_of_soccer(models: Path, tmp_path: Path) -> None:
    result, report = evaluated(models, tmp_path, "parcels", "--oracle", "3")
    assert result["settings"]["chain"] == "two_legs"
    assert len(result["runs"]["start"][0]) == 8
    assert re.findall(WORDS, report) == []
    assert "bend at the subgoal, degrees" in report
    assert "Figure 4" not in report


def test_a_chain_of_one_step_is_reported(models: Path, tmp_path: Path) -> None:
    result, report = evaluated(models, tmp_path, "shelves", "--chain", "one_leg", "--oracle", "3")
    assert [len(start) for start in result["runs"]["start"]] == [5, 5]
    assert "Subgoal refinement: go there" in report
    assert "plain bearing from robot to shelf" in report
    assert "bend at" not in report


def test_the_domain_draws_its_surroundings_and_each_object_is_a_dot() -> None:
    world, chain = PARCELS.chains["two_legs"](ROBOT, PARCELS.library(ROBOT), np.random.default_rng(3))
    runs = {"naive": {"path": [(0.0, 0.0)], "heading": 0.5, "duration": 1.0}}
    DRAWN.clear()
    (axes,) = charts.paths(ROBOT, chain, world, runs, draw).axes
    assert DRAWN == [ROBOT]
    dots = {(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines if line.get_marker() == "o"}
    assert dots == {(round(there.x, 4), round(there.y, 4)) for there in world.objects.values()}


def test_the_chain_is_the_domains_first_unless_it_is_named() -> None:
    assert Settings(seed=1, source=ToolsetSource(domain="parcels")).chain == "two_legs"
    assert Settings(seed=1, chain="one_leg", source=ToolsetSource(domain="parcels")).chain == "one_leg"


def test_soccer_shows_its_own() -> None:
    assert next(iter(SOCCER.chains)) == "dribble"
    assert SOCCER.presentation.place == "ball"
