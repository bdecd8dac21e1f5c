"""Durations of the actions relative to those of time-optimal motion."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.domains.soccer.quality.action_quality import Outcome
from ator_ros.domains.soccer.quality.quality_result import OverOptimal
from ator_ros.files import FileError, read_json, write_text


def over_time_optimal(kind: str, outcomes: Sequence[Outcome], folder: Path) -> OverOptimal | None:
    """Compare durations with those of time-optimal motion between the same poses, if they are known.

    Parameters
    ----------
    kind : str
        Kind of motion; part of the files' names.
    outcomes : sequence of Outcome
        Of n situations.
    folder : Path
        Holds ``pairs_KIND.json``, the n pairs of poses (m, m, rad), and ``optimal_KIND.json``, the n times in
        s that ``benchmarks/time_optimal.py`` prints for them (null: not solved). Without times the pairs are
        written there. Times of other pairs are neither used nor changed; a warning says so.

    Returns
    -------
    OverOptimal or None
        None without times.
    """
    pairs_file, times_file = folder / f"pairs_{kind}.json", folder / f"optimal_{kind}.json"
    pairs = [[list(pose) for pose in outcome.poses] for outcome in outcomes]
    if not times_file.is_file():
        write_text(pairs_file, json.dumps(pairs))
        return None
    times = _read(times_file)
    if _read(pairs_file) != pairs or not isinstance(times, list) or len(times) != len(pairs):
        print(f"{times_file}: left out: expected times of the {len(pairs)} pairs driven", file=sys.stderr)
        return None
    both = [
        (outcome.duration, time)
        for outcome, time in zip(outcomes, times, strict=True)
        if outcome.success and isinstance(time, float)
    ]
    if not both:
        return None
    own, best = np.mean(both, axis=0)
    return OverOptimal(len(both), round(float(best), 3), round(float(own / best), 3))


def _read(file: Path) -> Any:
    try:
        return read_json(file)
    except FileError:
        return None
