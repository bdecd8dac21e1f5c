"""The command line `bench`."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path

import pytest

from ator_ros.tools import bench
from ator_ros.tools.benchmarks import collection, refinement, simulation
from ator_ros.tools.work import bench as work


def test_the_report_holds_every_part_that_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = {"fast": lambda _: {"case": {"median_ms": 0.5, "not_run": "no java"}}, "other": lambda _: {}}
    monkeypatch.setattr(bench, "PARTS", tuple(parts))
    monkeypatch.setattr(work, "PARTS", parts)
    out = tmp_path / "benchmarks.json"
    assert bench.main(["--parts", "fast", "--out", str(out)]) == 0
    report = json.loads(out.read_text(encoding="utf-8"))
    assert report["fast"] == {"case": {"median_ms": 0.5, "not_run": "no java"}}
    assert "other" not in report
    assert bench.main(["--parts", "other", "--out", str(out)]) == 0
    parts_of_file = json.loads(out.read_text(encoding="utf-8")).keys() - work.FORMAT.head().keys()
    assert parts_of_file == {"fast", "other", "measured"}
    assert report["measured"]["fast"]["versions"]["numpy"]
    assert "median_ms 0.5  not_run no java" in capsys.readouterr().out


def test_a_report_is_gone_on_with_and_a_newer_one_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "PARTS", ("fast",))
    monkeypatch.setattr(work, "PARTS", {"fast": lambda _: {}})
    out = tmp_path / "benchmarks.json"
    out.write_text(json.dumps({**work.FORMAT.head(), "slow": {}}))
    assert bench.main(["--parts", "fast", "--out", str(out)]) == 0
    report = json.loads(out.read_text(encoding="utf-8"))
    assert {**work.FORMAT.head(), "slow": {}, "fast": {}}.items() <= report.items()
    newer = json.dumps({**report, "schema_version": 2})
    out.write_text(newer)
    assert bench.main(["--parts", "fast", "--out", str(out)]) == 1
    assert f"bench: {out}: schema_version: expected 1 to 1, got 2" in capsys.readouterr().err
    assert out.read_text() == newer


def test_a_part_that_cannot_be_measured_ends_with_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(options: Namespace) -> Mapping[str, object]:
        raise RuntimeError("expected the service within 40 s")

    monkeypatch.setattr(work, "PARTS", {"service": missing})
    out = tmp_path / "benchmarks.json"
    assert bench.main(["--parts", "service", "--out", str(out)]) == 1
    assert capsys.readouterr().err == "bench: service: expected the service within 40 s\n"
    assert not out.exists()


def test_the_simulation_is_measured_with_and_without_an_object() -> None:
    results = simulation.measure(blocks=1)
    assert set(results) == set(simulation.LIMITS_TIMES_REAL_TIME)
    assert all(row["times_real_time"] > 0.0 and row["over_bare_loop"] > 0.0 for row in results.values())


def test_collection_is_measured_with_one_process_and_with_two_workers() -> None:
    ((case, row),) = collection.measure(blocks=1, episodes=1).items()
    assert case == "2 x 1000 episodes"
    assert row["times_one_process"] == pytest.approx(row["one_process_s"] / row["two_workers_s"], rel=0.02)
    assert row["collection_s"] == pytest.approx(row["start_s"] + 2000 * row["two_workers_s"], rel=0.02)


def test_limits_are_judged() -> None:
    assert work.met({"times_real_time": 113.0, "limit_times_real_time": 100.0}) == {"met": True}
    assert work.met({"median_ms": 1.5, "p99_ms": 2.0, "limit_ms": 1.0}) == {"met": False}
    assert work.met({"ratio": 1.2, "limit_ratio": 1.5, "p99_ms": 6.0, "limit_p99_ms": 5.0}) == {"met": False}
    assert work.met({"median_ms": 1.5}) == {}


def test_of_refinement_the_quietest_round_counts() -> None:
    results = refinement.measure(requests=2, rounds=2)
    cases = {name: row for name, row in results.items() if "median_ms" in row}
    assert cases.keys() == refinement.CASES.keys()
    for row in cases.values():
        assert row["median_ms"] > 0.0
    assert len(results) == len(refinement.CASES) + len(refinement.LENGTHS)
    assert {name for name, row in results.items() if "limit_ms" in row} == refinement.LIMITS_MS.keys()
    row = refinement._row("any", [[3.0, 3.0], [1.0, 1.0], [2.0, 2.0]])
    assert (row["median_ms"], row["slowest_median_ms"]) == (1.0, 3.0)
