"""Share of the oracle's gain against the episodes that observed models were learned from: docs/learning.md.

    ros2 run ator_ros collect --seed 101 --episodes 1000 --out experience.parquet
    scripts/run python benchmarks/learning_curve.py experience.parquet --seed 431 --situations 60 --out curve

An interrupted curve goes on where it was; more situations may be asked for later. All models choose in the
same situations, each behind a gate that was learned from the same episodes, and share one executed oracle.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ator_ros.drawing import save_svg
from ator_ros.evaluation.learning_curve import CurveSettings, LearningCurve, points
from ator_ros.evaluation.running import RESUMES
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.report.charts import learning_curve
from ator_ros.report.terminal_tables import curve_table
from ator_ros.tools.guard import guarded

FORMAT = Format("ator_ros learning curve", 1, "learning curve")


def arguments() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    whole = CurveSettings("", 0)
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("table", type=Path, metavar="EXPERIENCE", help="table of experience, of all actions")
    parser.add_argument("--seed", type=int, required=True, help="of the situations")
    parser.add_argument("--situations", type=_number, required=True, metavar="N")
    parser.add_argument("--sizes", type=_number, nargs="+", default=whole.sizes, help="episodes per action")
    parser.add_argument("--draws", type=_number, default=whole.draws, help="of each size")
    parser.add_argument("--headings", type=_number, default=whole.headings, help="that the oracle executes")
    parser.add_argument("--speeds", type=float, nargs="*", default=whole.speeds, metavar="V", help="m/s")
    parser.add_argument("--margin", type=float, default=whole.margin, metavar="S", help="of the oracle")
    parser.add_argument(
        "--executed",
        default="",
        metavar="FOLDER",
        help="finished evaluation whose naive, described and oracle runs are taken (default: execute them)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    return parser


def _number(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected a number of at least 1, got {text}")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = arguments().parse_args(words)
    settings = CurveSettings(
        str(options.table),
        options.seed,
        tuple(sorted(set(options.sizes))),
        options.draws,
        options.headings,
        tuple(options.speeds),
        options.margin,
        executed=options.executed,
    )
    return guarded("learning_curve", lambda: _run(options, settings, words), interrupted=RESUMES)


def _run(options: argparse.Namespace, settings: CurveSettings, words: Sequence[str]) -> int:
    curve = LearningCurve(settings, options.out)
    for _ in tqdm(curve.learn(), total=len(curve.draws), desc="learning", unit="set", disable=None):
        pass
    bar = tqdm(total=options.situations, desc="playing", unit="situation", disable=None)
    records: list[dict[str, Any]] = []
    for records in curve.play(options.situations):
        bar.update(len(records) - bar.n)
    bar.close()
    told = points(records)
    result = {
        "command": portable_command("learning_curve", words),
        "seed": options.seed,
        "situations": len(records),
        "points": told,
    }
    write_text(options.out / "curve.json", FORMAT.text(result))
    save_svg(learning_curve(told), options.out / "curve.svg")
    print(curve_table(told))
    print(f"wrote {options.out / 'curve.json'} and {options.out / 'curve.svg'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
