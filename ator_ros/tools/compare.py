"""Execute the same chains over ROS and in the tools; report how durations and predictions differ."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command
from ator_ros.tools.command_line import (
    add_factor,
    add_models,
    add_setting,
    check_any,
    check_names,
    policies,
    settled,
)
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `compare`."""
    parser = argparse.ArgumentParser(prog="compare", description=__doc__)
    parser.add_argument("--situations", type=whole(1), default=50, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=941, help="of the situations (default: %(default)s)")
    add_setting(parser)
    add_models(parser)
    parser.add_argument(
        "--chains", nargs="+", metavar="NAME", help="taken in turn (default: the domain's first)"
    )
    parser.add_argument("--policies", nargs="+", default=["gated"], metavar="NAME", help="taken in turn")
    add_factor(parser, 1.0)
    parser.add_argument(
        "--out",
        type=destination,
        default=Path("build/compare.json"),
        metavar="FILE.json",
        help="default: %(default)s",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 1 where the nodes fail or the means are too far apart."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = arguments()
    options, domain = settled(parser, words)
    check_any(parser, "chains", domain.chains, domain)
    options.chains = options.chains or [next(iter(domain.chains))]
    check_names(parser, "chains", options.chains, domain.chains)
    check_names(parser, "policies", options.policies, policies())

    def run() -> int:
        from ator_ros.tools.work import compare as work

        return work.run(options, domain, portable_command("compare", words))

    return guarded("compare", run)


if __name__ == "__main__":
    sys.exit(main())
