"""The paper's performance models: its candidate features and amount of experience (paper, section 3)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ator_ros.files import portable_command, write_text
from ator_ros.tools.command_line import add_jobs, add_setting, asked, settled
from ator_ros.tools.guard import guarded
from ator_ros.tools.option_types import destination, whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `paper_models`."""
    parser = argparse.ArgumentParser(prog="paper_models", description=__doc__)
    add_setting(parser, robot=False)
    parser.set_defaults(action_set="bezier")
    parser.add_argument(
        "--episodes", type=whole(20), default=1000, help="of each action (default: %(default)s)"
    )
    parser.add_argument("--fresh", type=whole(20), default=1000, help="fresh ones (default: %(default)s)")
    parser.add_argument("--seed", type=whole(), default=111)
    parser.add_argument("--fresh-seed", type=whole(), default=221)
    add_jobs(parser)
    parser.add_argument("--out", type=destination, default=Path("docs/accuracy_paper.md"))
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Collect, learn, measure, and write the table; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options, domain = settled(arguments(), words)

    def run() -> int:
        from ator_ros.domains.measurements import PaperRun
        from ator_ros.evaluation.errors import EvaluationError

        if domain.measurements.paper_models is None:
            raise EvaluationError(f"domain: expected one with measurements.paper_models, got {domain.name}")
        command = portable_command("paper_models", words)
        text = domain.measurements.paper_models(asked(PaperRun, options, command))
        write_text(options.out, text)
        print(text)
        return 0

    return guarded("paper_models", run)


if __name__ == "__main__":
    sys.exit(main())
