"""The measurements in benchmarks/ that need our package alone, each on very few situations."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest
from documentation import ROOT

pytestmark = pytest.mark.long


def benchmark(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module(name)


def test_the_choice_among_alternatives_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    choice, out = benchmark("choice_among_alternatives", monkeypatch), tmp_path / "choice.json"
    evaluated = choice.evaluated
    asked = []

    def interrupted(tools: object, library: object, seed: int, index: int) -> object:
        asked.append(index)
        if asked == [0, 1]:
            raise KeyboardInterrupt
        return evaluated(tools, library, seed, index)

    monkeypatch.setattr(choice, "evaluated", interrupted)
    with pytest.raises(KeyboardInterrupt):
        choice.main(["--situations", "2", "--out", str(out)])
    assert choice.main(["--situations", "2", "--out", str(out)]) == 0
    assert asked == [0, 1, 1]
    result = json.loads(out.read_text(encoding="utf-8"))
    assert result["situations"] == 2
    assert [len(record["ways"]) for record in result["records"]] == [3, 3]
    assert sum(way["chosen"] for way in result["ways"]) == 2
    low, high = result["right_percent_ci95"]
    assert 0.0 <= low <= result["right_percent"] <= high <= 100.0


def test_the_search_is_measured_beside_references(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    quality, out = benchmark("search_quality", monkeypatch), tmp_path / "quality.json"
    names = ("heading", "two headings", "place, headings and speeds")
    monkeypatch.setattr(quality, "CASES", {name: quality.CASES[name] for name in names})
    monkeypatch.setattr(sys.modules["references"], "GENERATIONS", 60)
    assert quality.main(["--situations", "2", "--seed", "3", "--out", str(out)]) == 0
    result = json.loads(out.read_text(encoding="utf-8"))
    assert tuple(case["open"] for case in result["cases"]) == names
    assert [case["reference"] for case in result["cases"]] == [*2 * ["brute force"], "global optimiser"]
    for record in result["records"]:
        search, reference = record["search"], record["reference"]
        assert reference["cost"] - 0.05 < search["cost"] < 1.1 * reference["cost"]
        assert 0.8 * reference["duration"] < search["duration"] < 1.2 * reference["duration"]
    (tmp_path / "quality.jsonl").write_text('{"seed": 4}\n', encoding="utf-8")
    assert quality.main(["--situations", "2", "--seed", "3", "--out", str(out)]) == 2


def test_our_actions_are_compared_with_the_times_of_the_ball_ruler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ruler, shipped = benchmark("over_ball_ruler", monkeypatch), ROOT / "docs" / "ruler"
    for kind in ("approach", "dribble"):
        pairs = json.loads((shipped / f"pairs_{kind}.json").read_text(encoding="utf-8"))[:1]
        (tmp_path / f"pairs_{kind}.json").write_text(json.dumps(pairs), encoding="utf-8")
        times = json.loads((shipped / f"ball_{kind}.json").read_text(encoding="utf-8"))[:1]
        (tmp_path / f"ball_{kind}.json").write_text(json.dumps(times), encoding="utf-8")
    out = tmp_path / "over.json"
    words = ["--ruler", str(tmp_path), "--chains", "1", "--out", str(out)]
    assert ruler.main(words) == 2  # it has written the chains, whose times are awaited
    chains = json.loads((tmp_path / "situations_chain.json").read_text(encoding="utf-8"))
    assert chains == json.loads((shipped / "situations_chain.json").read_text(encoding="utf-8"))[:1]
    times = json.loads((shipped / "ball_chain.json").read_text(encoding="utf-8"))[:1]
    (tmp_path / "ball_chain.json").write_text(json.dumps(times), encoding="utf-8")
    assert ruler.main(words) == 0
    rows = json.loads(out.read_text(encoding="utf-8"))["rows"]
    assert [row["what"] for row in rows] == ["approach", "dribble", *ruler.CHAINS]
    assert all(1.0 <= row["ratio"] < 2.0 for row in rows)


def test_chosen_kinds_of_motion_are_nearer_to_all_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    families, out = benchmark("motion_families", monkeypatch), tmp_path / "families.json"
    robots = [str(ROOT / "config" / f"{name}.yaml") for name in ("turtlebot4", "pioneer")]
    words = ["--robots", *robots, "--situations", "60", "--seed", "3", "--out", str(out)]
    assert families.main(words) == 0
    written = out.read_text(encoding="utf-8")
    rows = json.loads(written)["rows"]
    assert [row["family"] for row in rows] == ["drive", "drive", "approach", "dribble"]
    for row in rows:
        assert row["few"] < row["chosen"] < row["grid"]
        assert row["least_s"] > 0.5
        assert 0.0 <= row["chosen_percent"] < row["few_percent"] < 10.0
    assert families.main(words) == 0
    assert out.read_text(encoding="utf-8") == written
