"""The verdict of `soak`."""

from __future__ import annotations

import os

import pytest

from ator_ros.tools.soak import NODES, Sample, Soak, sample, summary


def soak(last: Sample) -> Soak:
    samples = {name: [Sample(100.0, 9, 30)] * 4 + [last] for name in NODES}
    return Soak(chains=5, samples=samples, answers=[0.001] * 10)


def test_what_stays_as_it_was_is_no_complaint() -> None:
    report = summary(soak(Sample(103.0, 9, 30)))
    assert report["worse"] == []
    assert report["nodes_first_and_last_fifth"]["executor"]["memory"] == [100.0, 103.0]
    assert report["odom_to_command_ms"][1] == {"median": 1.0, "p99": 1.0}


@pytest.mark.parametrize(
    ("last", "told"),
    [
        (Sample(120.0, 9, 30), "memory of executor grew from 100.00 to 120.00"),
        (Sample(100.0, 10, 30), "threads of executor"),
        (Sample(100.0, 9, 31), "files of executor"),
    ],
)
def test_what_has_grown_is_named(last: Sample, told: str) -> None:
    assert any(told in line for line in summary(soak(last))["worse"])


def test_a_process_is_measured() -> None:
    own = sample(os.getpid())
    assert own.memory > 1.0
    assert own.threads >= 1
    assert own.files >= 3
