"""Measure how often chains succeed with the sensors of a real robot, or late states, against the truth."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import add_jobs, add_models, add_setting, check_names, policies, settled
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `noise`."""
    parser = argparse.ArgumentParser(prog="noise", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1), default=200, help="for each chain (default: %(default)s)"
    )
    parser.add_argument("--seed", type=whole(), default=911)
    add_setting(parser)
    parser.add_argument("--chains", nargs="+", metavar="NAME", help="default: all of the domain")
    parser.add_argument("--policy", default="refined", metavar="NAME", help="default: %(default)s")
    parser.add_argument(
        "--conditions", nargs="+", metavar="NAME", help="default: all; the truth is always among them"
    )
    add_models(parser)
    add_jobs(parser)
    parser.add_argument(
        "--out", type=destination, default=Path("robustness_noise.json"), help="default: %(default)s"
    )
    return parser


def _conditions() -> list[str]:
    from ator_ros.evaluation.noise import CONDITIONS

    return list(CONDITIONS)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = arguments()
    options, domain = settled(
        parser, words, chains=lambda domain: domain.chains, conditions=lambda _: _conditions()
    )
    check_names(parser, "policy", [options.policy], policies())

    def run() -> int:
        from ator_ros.tools.work import noise as work

        return work.run(options, domain, portable_command("noise", words))

    return guarded("noise", run)


if __name__ == "__main__":
    sys.exit(main())
