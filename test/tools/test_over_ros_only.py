"""Actions on servers without a stand-in: tools that simulate refuse them before anything is executed."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from domain_files import CHAIN, PLACE, TOUR, file_of

from ator_ros.tools import collect, evaluate, gate, study

Tool = Callable[[Sequence[str]], int]


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        (collect.main, ["--episodes", "2", "--seed", "1", "--out", "table.parquet"]),
        (evaluate.main, ["--situations", "1", "--policies", "naive", "--out", "out"]),
        (gate.main, ["--situations", "10", "--models", "models"]),
    ],
)
def test_it_is_refused_with_the_reason(
    tool: Tool,
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    data = copy.deepcopy(TOUR) | {"chains": [CHAIN]}
    data["actions"][0] |= {"drives": {"start": [PLACE], "goal": [PLACE]}}
    file = file_of(tmp_path, data)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").mkdir()
    assert tool([*words, "--domain", str(file)]) == 1
    assert "has no `stand_in`, so only `collect --over-ros`" in capsys.readouterr().err
    assert not (tmp_path / "table.parquet").exists()
    assert not list((tmp_path / "models").rglob("*.json"))


def test_a_study_of_such_actions_alone_leaves_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    action = TOUR["actions"][0] | {"drives": {"start": [PLACE], "goal": [PLACE]}}
    data = {**TOUR, "tops": TOUR["tops"][:1], "actions": [action], "chains": [CHAIN]}
    assert study.main(["--domain", str(file_of(tmp_path, data)), "--out", str(tmp_path / "study")]) == 1
    assert "has no `stand_in`, so only `collect --over-ros`" in capsys.readouterr().err
    assert not (tmp_path / "study").exists()
