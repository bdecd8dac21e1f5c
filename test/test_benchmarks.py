"""The benchmarks, each with few situations."""

from __future__ import annotations

from pathlib import Path

import pytest
from experience_rows import synthetic_experience

from ator_ros.experience.table import Experience, join, write_experience
from benchmarks import learners, search, speed


@pytest.mark.parametrize("part", speed.PARTS)
def test_each_part_of_the_speed_is_measured(part: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert speed.main([part, "--requests", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 2
    assert all(line.startswith((part, "longest tick")) for line in lines)


@pytest.mark.long
def test_learners_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "experience.parquet"
    metadata = {"seed": 1, "domain": "soccer", "action_set": "default"}
    write_experience(table, Experience(join([synthetic_experience("goToPose")]), metadata))
    assert learners.main([str(table), str(table)]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ator_ros")]
    assert len(rows) == 2


@pytest.mark.long
def test_the_search_is_compared_with_references(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "GENERATIONS", 60)
    names = ["heading", "place, headings and speeds"]
    assert search.main([*names, "--situations", "2", "--seed", "3"]) == 0
    output = capsys.readouterr().out
    assert "| heading | brute force" in output
    assert "| place, headings and speeds | global optimizer" in output
