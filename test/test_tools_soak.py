"""The verdict of `soak`."""

from __future__ import annotations

import itertools
import os

import pytest

from ator_ros.tools.soak import main
from ator_ros.tools.work.soak_report import NODES, Answer, Sample, Soak, report_of, sample
from ator_ros.tools.work.soak_result import Milliseconds


def soak(last: Sample) -> Soak:
    samples = {name: [Sample(100.0, 9, 30)] * 4 + [last] for name in NODES}
    return Soak(chains=5, samples=samples, answers=[ticks(0.001)] * 5)


def ticks(*delays: float) -> list[Answer]:
    """Return the answers of 20 ticks, delayed by `delays` s in turn."""
    return [
        Answer(0.05 * tick, 7.0 + 0.05 * tick, 7.0 + 0.05 * tick + delay)
        for tick, delay in zip(range(20), itertools.cycle(delays), strict=False)
    ]


def test_what_stays_as_it_was_is_no_complaint() -> None:
    report = report_of(soak(Sample(103.0, 9, 30)), "soak")
    assert report.worse == ()
    assert report.nodes["executor"].memory == (100.0, 103.0)
    assert report.odom_to_command_ms[1] == Milliseconds(1.0, 1.0, 1.0)
    assert report.tick_lateness_ms is None


@pytest.mark.parametrize(
    ("last", "told"),
    [
        (Sample(120.0, 9, 30), "memory of executor grew from 100.00 to 120.00"),
        (Sample(100.0, 10, 30), "threads of executor"),
        (Sample(100.0, 9, 31), "files of executor"),
    ],
)
def test_what_has_grown_is_named(last: Sample, told: str) -> None:
    assert any(told in line for line in report_of(soak(last), "soak").worse)


def test_answers_that_come_later_and_chains_that_fail_are_named() -> None:
    seen = soak(Sample(100.0, 9, 30))
    seen.answers[-1] = ticks(0.02)
    seen.failures = ["lost"]
    assert report_of(seen, "soak").worse == (
        "the median time to a command grew from 1.0 to 20.0 ms",
        "1 of 5 chains failed",
    )
    assert report_of(seen, "soak").failures == {"lost": 1}


def test_at_real_time_ticks_and_cpu_are_judged() -> None:
    seen = soak(Sample(100.0, 9, 30))
    seen.idle_cpu, seen.busy, seen.busy_cpu = {"refinement": 0.01}, 100.0, dict.fromkeys(NODES, 10.0)
    report = report_of(seen, "soak", real_time=True)
    assert report.worse == ()
    assert report.tick_lateness_ms is not None
    assert report.tick_lateness_ms.share_within_5_ms == 1.0
    seen.answers[0] = ticks(0.0, 0.0, 0.0, 0.006)
    seen.idle_cpu, seen.busy = {"refinement": 0.03}, 50.0
    late, executor, refinement = report_of(seen, "soak", real_time=True).worse
    assert "expected 99% of the ticks within 5 ms, got 95.00%" in late
    assert "the executor takes 20.0% of a core" in executor
    assert "refinement idle takes 3.0%" in refinement


@pytest.mark.parametrize("option", ["--duration", "--real-time-factor"])
@pytest.mark.parametrize("text", ["nan", "inf", "-1", "long", ""])
def test_times_that_make_no_sense_are_refused(
    option: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([f"{option}={text}"])
    assert f"argument {option}: expected a finite number from 0, got {text!r}" in capsys.readouterr().err


def test_a_process_is_measured() -> None:
    own = sample(os.getpid())
    assert own.memory > 1.0
    assert own.threads >= 1
    assert own.files >= 3
