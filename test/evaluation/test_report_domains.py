"""Reports of evaluations: those that ship, and those of other domains, without soccer terms."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documentation import ROOT
from domain_files import install
from experience_rows import synthetic_experience
from outside.delivery import DELIVERY, two_visits

from ator_ros.bases.description import Robot
from ator_ros.evaluation.report import REPORT, write_report
from ator_ros.evaluation.running import KIND, RESULT
from ator_ros.files import load
from ator_ros.performance.model_file import save_model
from ator_ros.performance.training import train
from ator_ros.tools import evaluate
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World

WORDS = r"\b(balls?|goToBall|goToPose|dribble\w*|shoot|soccer|533)\b"


def one_visit(
    robot: Robot, library: TopLibrary, rng: np.random.Generator
) -> tuple[World, TopChain]:
    """Draw a chain of one step."""
    world, chain = two_visits(robot, library, rng)
    return world, TopChain(chain.calls[:1])


VISITS = dataclasses.replace(DELIVERY, chains={"two_visits": two_visits, "one_visit": one_visit})


@pytest.mark.parametrize(("chain", "count"), [("two_visits", 8), ("one_visit", 5)])
def test_a_report_of_another_domain_has_no_soccer_terms(
    chain: str, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, "delivery", "test_report_domains:VISITS")
    model = train("turnDriveTurn", synthetic_experience("turnDriveTurn"), VISITS.robot())
    save_model(tmp_path / "models" / "turnDriveTurn.json", model)
    words = (
        f"--domain delivery --chain {chain} --situations 2 --oracle 3 --jobs 1 --seed 405".split()
    )
    words += ["--policies", "naive", "face_goal", "analytic", "refined"]
    assert (
        evaluate.main([*words, "--models", str(tmp_path / "models"), "--out", str(tmp_path)]) == 0
    )
    result = json.loads((tmp_path / "evaluation.json").read_text())
    assert [len(start) for start in result["runs"]["start"]] == [count] * 2
    report = (tmp_path / "report.html").read_text()
    assert f"Subgoal refinement: chain {chain} of delivery" in report
    assert re.findall(WORDS, report) == []


@pytest.mark.parametrize(
    "folder", sorted((ROOT / "docs").glob("evaluation*")), ids=lambda folder: folder.name
)
def test_the_shipped_reports_are_those_of_their_results(folder: Path, tmp_path: Path) -> None:
    report = write_report(tmp_path, load(folder / RESULT, KIND, dict[str, Any]))
    assert report.read_text(encoding="utf-8") == (folder / REPORT).read_text(encoding="utf-8")
