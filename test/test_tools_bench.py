"""The command line `bench`."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import json
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path

import pytest

from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.files import read_json
from ator_ros.schema import structured, unstructured
from ator_ros.tools import bench
from ator_ros.tools.benchmarks import collection, refinement, simulation
from ator_ros.tools.benchmarks.rows import MeasuredLearner, NotRun, RefinementTime, RoundTrip, SimulationSpeed
from ator_ros.tools.work import bench as work
from ator_ros.tools.work.bench_report import FORMAT, BenchReport, judged

SOURCE = ToolsetSource()
LEARNER = MeasuredLearner(fit_s=0.5, rmse_s=0.25, mae_s=0.125)


def report_in(file: Path) -> BenchReport:
    return structured(FORMAT.content(read_json(file)), BenchReport, closed=True)


def test_the_report_holds_every_part_that_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    measured: Mapping[str, Mapping[str, object]] = {
        "learners": {"case": LEARNER, "other": NotRun("no java")},
        "plans": {},
    }
    monkeypatch.setattr(work, "measured", lambda part, *_: measured[part])
    out = tmp_path / "benchmarks.json"
    assert bench.main(["--parts", "learners", "--out", str(out)]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["learners"] == {
        "case": {"fit_s": 0.5, "rmse_s": 0.25, "mae_s": 0.125},
        "other": {"not_run": "no java"},
    }
    assert report_in(out).plans is None
    assert bench.main(["--parts", "plans", "--out", str(out)]) == 0
    report = report_in(out)
    assert (report.learners, report.plans) == (measured["learners"], {})
    assert report.measured.keys() == {"learners", "plans"}
    assert report.measured["learners"].versions["numpy"]
    told = capsys.readouterr().out
    assert "fit_s 0.5  rmse_s 0.25" in told
    assert "not_run no java" in told


def test_a_report_is_gone_on_with_and_a_newer_one_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(work, "measured", lambda *_: {})
    out = tmp_path / "benchmarks.json"
    before = BenchReport(learners={"case": LEARNER})
    out.write_text(FORMAT.text(unstructured(before)))
    assert bench.main(["--parts", "plans", "--out", str(out)]) == 0
    report = report_in(out)
    assert dataclasses.replace(report, measured={}) == dataclasses.replace(before, plans={})
    newer = json.dumps({**FORMAT.head(), "schema_version": 2, **unstructured(report)})
    out.write_text(newer)
    assert bench.main(["--parts", "plans", "--out", str(out)]) == 1
    assert f"bench: {out}: schema_version: expected 1 to 1, got 2" in capsys.readouterr().err
    assert out.read_text() == newer


def test_a_part_that_cannot_be_measured_ends_with_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(part: str, source: ToolsetSource, options: Namespace) -> Mapping[str, object]:
        raise RuntimeError("expected the service within 40 s")

    monkeypatch.setattr(work, "measured", missing)
    out = tmp_path / "benchmarks.json"
    assert bench.main(["--parts", "service", "--out", str(out)]) == 1
    assert capsys.readouterr().err == "bench: service: expected the service within 40 s\n"
    assert not out.exists()


def test_the_simulation_is_measured_with_and_without_an_object() -> None:
    results = simulation.measure(SOURCE, blocks=1)
    assert set(results) == set(simulation.LIMITS_TIMES_REAL_TIME)
    assert all(row.times_real_time > 0.0 and row.over_bare_loop > 0.0 for row in results.values())


def test_collection_is_measured_with_one_process_and_with_two_workers() -> None:
    ((case, row),) = collection.measure(SOURCE, blocks=1, episodes=1).items()
    assert case == "2 x 1000 episodes"
    assert row.times_one_process == pytest.approx(row.one_process_s / row.two_workers_s, rel=0.02)
    assert row.collection_s == pytest.approx(row.start_s + 2000 * row.two_workers_s, rel=0.02)


def test_each_part_has_its_field_and_its_module() -> None:
    assert tuple(field.name for field in dataclasses.fields(BenchReport)) == (*bench.PARTS, "measured")
    for part in bench.PARTS:
        module = importlib.import_module(f"ator_ros.tools.benchmarks.{part}")
        assert next(iter(inspect.signature(module.measure).parameters)) == "source"


def test_limits_are_judged() -> None:
    assert judged(SimulationSpeed(113.0, 100.0, 1.0, 1.3)).met is True
    assert judged(SimulationSpeed(99.0, 100.0, 1.0, 1.3)).met is False
    assert judged(RefinementTime(1.5, 2.0, 2.0, 1.0)).met is False
    assert judged(RoundTrip(9, 1.0, 6.0, 1.2, 1.5, 5.0, 0.0)).met is False
    assert judged(RefinementTime(1.5, 2.0, 2.0)).met is None
    assert judged(LEARNER) == LEARNER


def test_the_shipped_report_is_judged_as_it_says() -> None:
    report = report_in(Path(__file__).parents[1] / "docs" / "benchmarks.json")
    rows = [row for part in bench.PARTS for row in (getattr(report, part) or {}).values()]
    assert len(rows) > 40
    for row in rows:
        assert judged(row) == row


@pytest.mark.long
def test_refinement_is_measured_in_every_case() -> None:
    results = refinement.measure(SOURCE, requests=2, rounds=2)
    cases = {name: row for name, row in results.items() if isinstance(row, RefinementTime)}
    assert cases.keys() == refinement.CASES.keys()
    for row in cases.values():
        assert row.median_ms > 0.0
    assert len(results) == len(refinement.CASES) + len(refinement.LENGTHS)
    assert {name for name, row in cases.items() if row.limit_ms} == refinement.LIMITS_MS.keys()


def test_of_refinement_the_quietest_round_counts() -> None:
    row = refinement.best_round("any", [[3.0, 3.0], [1.0, 1.0], [2.0, 2.0]])
    assert (row.median_ms, row.slowest_median_ms) == (1.0, 3.0)
