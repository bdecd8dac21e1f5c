"""Evaluate learning while playing, on robots that have changed: `evaluate --learning`."""

from __future__ import annotations

import argparse
from typing import Any

from tqdm import tqdm

from ator_ros.drawing import save_svg
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.files import write_text
from ator_ros.formats import Format
from ator_ros.learning.changed import CHANGES
from ator_ros.learning.stream import StreamSettings
from ator_ros.learning.stream_results import play, summary
from ator_ros.report.charts import stream_gains
from ator_ros.report.terminal_tables import stream_table
from ator_ros.tools.command_line import source_of

FORMAT = Format("ator_ros learning", 1, "evaluation of learning")
_AFTER = 150
"""Chains after which gains are compared; half of them where fewer are played."""


def run(options: argparse.Namespace, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    source = source_of(options)
    streams: dict[str, list[dict[str, Any]]] = {}
    summaries: dict[str, dict[str, Any]] = {}
    for change in options.learning or CHANGES:
        if change not in CHANGES:
            raise EvaluationError(f"--learning: expected some of {', '.join(CHANGES)}, got {change!r}")
        settings = StreamSettings(
            change,
            options.seed,
            options.chain,
            offline=options.offline,
            explore=options.explore,
            oracle=options.oracle,
            source=source,
        )
        results: list[dict[str, Any]] = []
        bar = tqdm(total=options.situations, desc=change, unit="chain", disable=None)
        for results in play(settings, options.situations, options.out / change):
            bar.update(len(results) - bar.n)
        bar.close()
        streams[change] = results
        summaries[change] = summary(results, min(_AFTER, len(results) // 2))
    told = {"command": command, "seed": options.seed, "changes": summaries}
    write_text(options.out / "learning.json", FORMAT.text(told))
    save_svg(stream_gains(streams), options.out / "learning.svg")
    print(stream_table(summaries))
    print(f"wrote {options.out / 'learning.json'} and {options.out / 'learning.svg'}")
    return 0
