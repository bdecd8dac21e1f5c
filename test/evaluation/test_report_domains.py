"""Evaluations and reports of other domains, without soccer terms."""

import json
import re
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from experience_rows import synthetic_experience
from parcels import PARCELS

from ator_ros.domains import domain as domains
from ator_ros.performance.model_file import save_model
from ator_ros.performance.training import train
from ator_ros.tools import evaluate

WORDS = r"\b(balls?|goToBall|goToPose|dribble\w*|shoot|soccer|533)\b"


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [EntryPoint("parcels", "parcels:PARCELS", domains.GROUP)]
    monkeypatch.setattr(domains, "entry_points", lambda **_: entries)


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    save_model(folder / "carry.json", train("carry", synthetic_experience("carry"), PARCELS.robot()))
    return folder


def evaluated(models: Path, out: Path, *words: str) -> tuple[dict[str, Any], str]:
    place = ["--models", str(models), "--out", str(out), "--jobs", "1", "--seed", "405"]
    policies = ["--policies", "naive", "face_goal", "analytic", "refined", "--situations", "2"]
    assert evaluate.main(["--domain", "parcels", *place, *policies, *words]) == 0
    result = json.loads((out / "evaluation.json").read_text())
    return result, (out / "report.html").read_text()


def test_a_report_of_another_domain_has_no_soccer_terms(models: Path, tmp_path: Path) -> None:
    result, report = evaluated(models, tmp_path, "--oracle", "3")
    assert result["settings"]["chain"] == "two_legs"
    assert len(result["runs"]["start"][0]) == 8
    assert re.findall(WORDS, report) == []


def test_a_chain_of_one_step_is_reported(models: Path, tmp_path: Path) -> None:
    result, report = evaluated(models, tmp_path, "--chain", "one_leg", "--oracle", "3")
    assert [len(start) for start in result["runs"]["start"]] == [5, 5]
    assert "Subgoal refinement: chain one_leg of parcels" in report
