"""Measure what refinement gains with and without the gate, with models from few drives.

scripts/run python scripts/few_drives.py --domains pursuit tour --work few_drives

The same with `--domains building --drives 200` measures the domain with a map.

For each domain it collects random drives of each action without ROS, learns from them, and executes
the same new chains with every model. Without drives path times predict. The oracle is executed
once, with the model of most drives. After an interruption, the same command resumes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.comparison import Settings
from ator_ros.evaluation.running import KIND, RESULT
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.files import load, write_text
from ator_ros.tools.collect import collect
from ator_ros.tools.evaluate import evaluate
from ator_ros.tools.train import train

UNLEARNED = {
    "fixed": "heading 0",
    "arrive": "bearing of the arrival",
    "face_goal": "bearing of the next goal",
    "analytic": "path times alone",
}
"""Headings without learned models: policies, and their rows in the table."""
POLICIES = ("naive", "refined", "gated")


def measured(
    domain_name: str, drives: int, work: Path, options: argparse.Namespace
) -> dict[str, Any]:
    """Collect, train and evaluate unless that is done; return the summary of the evaluation."""
    domain = find_domain(domain_name)
    name = domain_name if options.robot is None else f"{domain_name}_{options.robot.stem}"
    folder = work / f"{name}_{drives}"
    robot = "" if options.robot is None else str(options.robot)
    source = ToolsetSource(domain=domain_name, robot=robot, models=str(folder / "models"))
    table = folder / "experience.parquet"
    out = folder / "evaluation"
    if (out / RESULT).exists():
        summary = dict(load(out / RESULT, KIND, dict[str, Any])["summary"])
        seed = summary["seed"]
        chains = summary["situations"]
        if (seed, chains) != (options.seed, options.chains):
            expected = f"expected seed {options.seed} and {options.chains} chains"
            raise SystemExit(f"{out}: {expected}, got seed {seed} and {chains} chains")
        return summary
    folder.mkdir(parents=True, exist_ok=True)
    command = "scripts/few_drives.py"
    if not drives:  # path times
        Path(source.models).mkdir(exist_ok=True)
    elif not table.exists():
        actions = list(domain.actions())
        collect(
            actions,
            source,
            table,
            command=command,
            episodes=drives,
            seed=options.seed + drives,
        )
    if drives:
        train(
            [table],
            Path(source.models),
            command=command,
            domain=domain,
            robot=domain.robot(options.robot),
        )
    most = max(options.drives)
    first = drives == most
    settings = Settings(
        options.seed,
        next(iter(domain.chains)),
        (*POLICIES, *UNLEARNED) if first else POLICIES,
        oracle=options.oracle if first else 0,
        oracle_margin=0.3 if first else None,
        source=source,
    )
    others = None if first else work / f"{name}_{most}" / "evaluation"
    evaluate(settings, out, command=command, situations=options.chains, oracle_from=others)
    return dict(load(out / RESULT, KIND, dict[str, Any])["summary"])


def rows(domain_name: str, summaries: dict[int, dict[str, Any]]) -> Iterator[str]:
    """Yield the rows of one domain."""
    summary = summaries[max(summaries)]
    if "oracle" not in summary:
        raise SystemExit(
            f"--drives: expected the greatest number of earlier runs too, got {max(summaries)}"
        )
    oracle = summary["oracle"]
    naive = summary["naive"]
    yield f"| {domain_name} | naive | {naive['mean_duration_s']:.2f} s | | | |"
    yield f"| | oracle | {oracle['mean_duration_s']:.2f} s | {_gain(oracle)} | | |"
    for policy, meaning in UNLEARNED.items():
        yield f"| | {meaning} | {_result(summary[policy])} |"
    for drives, found in sorted(summaries.items()):
        yield f"| | refined, {drives} drives | {_result(found['refined'])} |"
        yield f"| | behind the gate | {_result(found['gated'])} |"


def _gain(row: dict[str, Any]) -> str:
    low, high = row["improvement_ci95"]
    return f"{row['improvement_percent']:.1f} % ({low:.1f} to {high:.1f})"


def _result(row: dict[str, Any]) -> str:
    share = row["oracle_captured_percent"]
    shown = "" if share is None else f"{share:.0f} %"
    return f"{row['mean_duration_s']:.2f} s | {_gain(row)} | {shown} | {row['lower']}"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--domains", nargs="+", default=["pursuit", "tour"])
    parser.add_argument(
        "--drives",
        nargs="+",
        type=int,
        default=[0, 20, 50, 100, 200],
    )
    parser.add_argument("--robot", type=Path, help="file of a robot (default: the domain's)")
    parser.add_argument("--chains", type=int, default=500)
    parser.add_argument("--oracle", type=int, default=12)
    parser.add_argument("--seed", type=int, default=6040)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--out", type=Path, help="file of the table (default: printed)")
    options = parser.parse_args(argv)
    lines = [
        "| domain | headings | duration | gain over naive (95 %) | of the oracle's "
        "| slower by over 2 % |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name in options.domains:
        most_first = sorted(options.drives, reverse=True)
        summaries = {}
        for drives in most_first:
            summaries[drives] = measured(name, drives, options.work, options)
        lines += rows(name, summaries)
    text = "\n".join(lines) + "\n"
    if options.out:
        write_text(options.out, text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
