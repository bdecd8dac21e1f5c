"""Run chains back to back over ROS for a set time, and compare the nodes at the end with the beginning.

At real time (--real-time-factor 1) the punctuality of ticks and the nodes' CPU are judged, too. The exit
code is 1 where something is worse than it should be; what has been seen is written every minute.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ator_ros.experience.table import library_versions
from ator_ros.files import write_text
from ator_ros.tools.command_line import destination, whole
from ator_ros.tools.soak_report import MEANING, Soak, summary
from ator_ros.tools.soak_run import run


def report_of(soak: Soak, *, duration: float, real_time_factor: float, seed: int) -> dict[str, Any]:
    """Return what is written: self-explaining, also while the run goes on."""
    return {
        "command": f"soak --duration {duration:g} --real-time-factor {real_time_factor:g} --seed {seed}",
        "machine": f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}",
        "versions": library_versions(),
        "meaning": MEANING,
        **summary(soak, real_time=real_time_factor == 1.0),
    }


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `soak`."""
    parser = argparse.ArgumentParser(prog="soak", description=__doc__)
    parser.add_argument("--duration", type=_number, default=120.0, metavar="S", help="default: %(default)s")
    parser.add_argument("--real-time-factor", type=_number, default=0.0, metavar="F", help="0: highest")
    parser.add_argument("--seed", type=whole(), default=701)
    parser.add_argument("--out", type=destination, default=Path("build/soak.json"), metavar="FILE.json")
    return parser


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a finite number from 0, got {text!r}")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 1 where something is worse than it should be."""
    options = arguments().parse_args(argv)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    how = {name: getattr(options, name) for name in ("duration", "real_time_factor", "seed")}

    def write(soak: Soak) -> None:
        if soak.answers:
            write_text(options.out, json.dumps(report_of(soak, **how), indent=1) + "\n")

    try:
        soak = run(**how, write=write)
    except ImportError as error:
        print(f"soak: {error}: source your ROS 2 workspace, or use make run", file=sys.stderr)
        return 1
    except (RuntimeError, OSError) as error:  # a node that has ended is one
        print(f"soak: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted")
        return 130
    if not soak.answers:
        print(
            f"soak: expected chains after the warm-up, {options.duration:g} s are too short", file=sys.stderr
        )
        return 1
    report = report_of(soak, **how)
    print(json.dumps(report, indent=1))
    return 1 if report["worse"] else 0


if __name__ == "__main__":
    sys.exit(main())
