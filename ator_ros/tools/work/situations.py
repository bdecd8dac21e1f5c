"""Execution of random situations with the jobs and backend that a command line names."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from ator_ros.evaluation.running import run_situations
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.experience.parallel import cluster


def executed(settings: Settings, options: argparse.Namespace, folder: Path) -> list[Record]:
    """Execute `options.situations` situations with the jobs and backend of the options, and a progress bar.

    Parameters
    ----------
    settings : Settings
        What the results depend on.
    options : argparse.Namespace
        With those of `add_parallel_options`.
    folder : Path
        For partial results: the same call resumes where it was interrupted.
    """
    with cluster(options.cluster):
        return run_situations(
            settings,
            situations=options.situations,
            folder=folder,
            jobs=options.jobs,
            backend=options.backend,
            progress=lambda records, done, total: tqdm(
                records, initial=done, total=total, unit="situation", smoothing=0.05, disable=None
            ),
        )
