"""Study a robot in one folder: collect experience, train models, evaluate, report.

After an interruption, the same command resumes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.domains.domain import Domain, DomainError
from ator_ros.domains.trials import (
    possible_actions,
    possible_chain,
    random_trial,
)
from ator_ros.evaluation.comparison import Settings
from ator_ros.evaluation.running import KIND as EVALUATION
from ator_ros.evaluation.running import RESULT
from ator_ros.evaluation.study_report import open_variables, study_page
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.experience.json_lines import PartialResults
from ator_ros.experience.table import join, read_experience
from ator_ros.files import load, save, write_text
from ator_ros.performance.model_file import load_model
from ator_ros.printable import one_line
from ator_ros.tools.collect import collect
from ator_ros.tools.command_line import (
    RESUMES,
    add_parallel_options,
    add_setting,
    run_tool,
    source_of,
    whole,
)
from ator_ros.tools.evaluate import evaluate
from ator_ros.tools.train import train

KIND = "study"
POLICIES = (
    "naive", "analytic", "refined", "gated", "analytic_speed", "refined_speed", "gated_speed",
)  # fmt: skip
_MOST_EXPLAINED = 50  # situations in which open variables are explained
# s: the oracle skips headings predicted to take this much longer than the best one
_ORACLE_MARGIN = 0.5


def study(options: argparse.Namespace, domain: Domain, command: str) -> None:
    """Collect, train and evaluate for a robot; write `study.json` and `study.html` to `--out`.

    Fresh episodes and the evaluation use the two seeds after that of the episodes. What is already
    in `--out` is used, if it is that of the same study.
    """
    out = options.out
    source = replace(source_of(options), models=str(out / "models"))
    robot = source.described()
    actions, left_out = possible_actions(domain, source.action_set, robot)
    if not actions:
        reasons = "; ".join(dict.fromkeys(left_out.values()))
        raise DomainError(reasons or f"{domain.name}: no actions")
    for name, reason in left_out.items():
        print(one_line(f"study: skipped {name}: {reason}"), file=sys.stderr)
    named = ("episodes", "situations", "seed", "chain", "oracle")
    identity = {
        **{name: getattr(options, name) for name in named},
        "robot": robot.description_digest(),
        "domain": source.domain,
        "action_set": source.action_set,
    }
    tables = [out / "experience.parquet", out / "fresh.parquet"]
    with PartialResults(out / "study.jsonl", identity, "a study with the same options") as partial:
        for seed, table in enumerate(tables, options.seed):
            if not table.exists():
                print(f"study: {table.stem}", flush=True)
                label = f"collect of study, seed {seed}"
                collect(actions, source, table, command=label, episodes=options.episodes, seed=seed)
                partial.append({"table": table.name})
    models = {action: source.folder() / f"{action}.json" for action in actions}
    if not all(file.exists() for file in models.values()):
        print("study: models", flush=True)
        train(
            tables[:1],
            Path(source.models),
            command="train of study",
            fresh=tables[1:],
            domain=domain,
            robot=robot,
        )
    learned = [name for name, file in models.items() if file.exists()]
    library = domain.library(robot, source.action_set)
    chain = possible_chain(domain, library, options.chain, learned)
    evaluation: dict[str, Any] | None = None
    variables: list[dict[str, Any]] = []
    if chain is None:
        print(f"study: no evaluation: no chain of {domain.name} has only {', '.join(learned)}")
    else:
        evaluation, variables = _evaluated(options, domain, source, chain)
    frames = (read_experience(table).frame for table in tables)
    ends = join(frame.drop_duplicates(["action", "episode"], keep="last") for frame in frames)
    result = {
        "command": command,
        "robot": robot.name,
        "robot_digest": robot.digest(),
        "domain": domain.name,
        "action_set": source.action_set,
        "actions": {
            name: _measured(ends[ends["action"] == name], file, source)
            for name, file in models.items()
        },
        "left_out": left_out,
        "chain": chain,
        "evaluation": evaluation,
        "variables": variables,
    }
    save(out / "study.json", KIND, result)
    write_text(out / "study.html", study_page(result))
    print(f"wrote {out / 'study.json'} and {out / 'study.html'}")


def _evaluated(
    options: argparse.Namespace, domain: Domain, source: ToolsetSource, chain: str
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Evaluate a chain; return the summary and what is known of its open variables."""
    folder = options.out / "evaluation"
    seed = options.seed + 2
    if not (folder / RESULT).exists():
        print("study: evaluation", flush=True)
        margin = _ORACLE_MARGIN if options.oracle else None
        settings = Settings(seed, chain, POLICIES, options.oracle, margin, source=source)
        evaluate(settings, folder, command="evaluate of study", situations=options.situations)
    summary = load(folder / RESULT, EVALUATION, dict[str, Any])["summary"]
    tools, library = tools_of(source)
    trials = [
        random_trial(domain, chain, library, seed=seed, index=index)
        for index in range(min(options.situations, _MOST_EXPLAINED))
    ]
    variables = open_variables(tools, trials)
    for each in variables:
        print(f"study: step {each['step']} ({each['top']}), {each['name']}: {each['explanation']}")
    return summary, variables


def _measured(ends: pd.DataFrame, model: Path, source: ToolsetSource) -> dict[str, Any]:
    """Return the performance of an action by the ends of its episodes, and its model's accuracy."""
    succeeded = ends[ends["success"]]
    failures = ends.loc[~ends["success"], "reason"].value_counts()
    accuracy: dict[str, Any] = {}
    if model.exists():
        features = source.in_domain().known_features
        accuracy = load_model(model, source.described(), features).metadata["accuracy"]
    duration = round(float(succeeded["duration"].mean()), 3) if len(succeeded) else None
    return {
        "episodes": len(ends),
        "success": round(len(succeeded) / len(ends), 5),
        "mean_duration_s": duration,
        "accuracy": accuracy,
        "failures": {str(reason): int(count) for reason, count in failures.items()},
    }


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `study`."""
    parser = argparse.ArgumentParser(prog="study", description=__doc__)
    add_setting(parser)
    parser.add_argument(
        "--episodes", type=whole(20), default=1000, metavar="N",
        help="of each action, at least 20 (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--situations", type=whole(10), default=200, metavar="M",
        help="that the evaluation executes, at least 10 (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=whole(), default=1, metavar="S",
        help="of the episodes; fresh episodes and the evaluation use the next two "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--chain", metavar="NAME", help="to evaluate (default: the domain's first)")
    parser.add_argument(
        "--oracle", type=whole(), default=24, metavar="K",
        help="headings of each subgoal that the oracle executes (default: %(default)s)",
    )  # fmt: skip
    add_parallel_options(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("study"), metavar="DIR", help="default: %(default)s"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(
        arguments(),
        study,
        argv,
        interrupted=RESUMES,
        needed=False,
        chain=lambda domain: domain.chains,
    )
