"""Study a robot with the other tools: each step runs one of them, unless its result is there already."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.open_variables import OpenVariable, open_variables
from ator_ros.evaluation.storage import RESULT, read_result
from ator_ros.evaluation.study_result import (
    FORMAT,
    SETTINGS,
    MeasuredAction,
    StudyResult,
    StudySettings,
)
from ator_ros.evaluation.toolset import ToolsetSource, make_library, tools_of
from ator_ros.evaluation.trials import random_trial
from ator_ros.experience.table import join, read_experience
from ator_ros.files import read_json, write_text
from ator_ros.performance.model_file import load_model
from ator_ros.refinement.gate import GATE
from ator_ros.report.study_page import study_page
from ator_ros.robot.description import Robot
from ator_ros.schema import SchemaError, structured, unstructured
from ator_ros.tools import collect, evaluate, gate, train
from ator_ros.tools.command_line import settled, source_of
from ator_ros.tools.guard import INTERRUPTED
from ator_ros.tools.work import collect as collecting
from ator_ros.tools.work import evaluate as evaluating
from ator_ros.tools.work import gate as gating
from ator_ros.tools.work import train as training
from ator_ros.tools.work.possible import possible_actions, possible_chain

POLICIES = ("naive", "refined", "gated", "refined_speed", "gated_speed")
EXPLAINED = 50
"""Situations in which open variables are explained, at most."""
MARGIN_S = "1.0"
"""Headings predicted to take this much longer than the best are not executed by the oracle."""


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    source = source_of(options, models=str(options.out / "models"))
    robot = source.described()
    _begin(options, robot)
    actions, left_out = possible_actions(domain, options.action_set, robot)
    for name, reason in left_out.items():
        print(f"study: without {name}: {reason}", file=sys.stderr)
    if not actions:
        raise EvaluationError(f"robot {robot.name}: expected an action that it can execute, got none")
    tables = {
        kind: _collected(options, kind, seed, actions) for seed, kind in enumerate(("experience", "fresh"))
    }
    _trained(options, source, tables, actions)
    learned = [name for name in actions if (source.folder() / f"{name}.json").exists()]
    chain = possible_chain(domain, make_library(robot, source), options.chain, learned)
    evaluation: dict[str, Any] | None = None
    variables: tuple[OpenVariable, ...] = ()
    if chain is None:
        print(f"study: without an evaluation: no chain of {domain.name} has only {', '.join(learned)}")
    else:
        evaluation = _evaluated(options, source, chain)
        variables = _variables(options, source, chain)
    result = StudyResult(
        command=command,
        robot=robot.name,
        robot_digest=robot.digest(),
        domain=domain.name,
        action_set=options.action_set,
        actions={name: _measured(options, name, source, robot) for name in actions},
        left_out=left_out,
        chain=chain,
        evaluation=evaluation,
        variables=variables,
    )
    write_text(options.out / "study.json", FORMAT.text(unstructured(result)))
    write_text(options.out / "study.html", study_page(result))
    print(f"wrote {options.out / 'study.json'} and {options.out / 'study.html'}")
    return 0


def _begin(options: argparse.Namespace, robot: Robot) -> None:
    """Make sure that the folder is empty, or one of the same study."""
    names = (item.name for item in fields(StudySettings) if item.name != "description_digest")
    ours = StudySettings(robot.description_digest(), **{name: getattr(options, name) for name in names})
    file = options.out / "settings.json"
    if not os.path.lexists(file):
        write_text(file, SETTINGS.text(unstructured(ours)))
        return
    try:
        theirs = structured(SETTINGS.content(read_json(file)), StudySettings)
    except SchemaError as error:
        raise EvaluationError(f"{file}: {error}: choose another --out") from error
    for name, value in vars(ours).items():
        found = getattr(theirs, name)
        if found != value:
            raise EvaluationError(
                f"{file}: {name}: expected {found!r} as in the folder's study, got {value!r}: "
                "choose another --out"
            )


def _setting(options: argparse.Namespace) -> list[str]:
    words = ["--domain", options.domain, "--jobs", str(options.jobs)]
    return [*words, *(["--robot", options.robot] if options.robot else [])]


def _collected(options: argparse.Namespace, kind: str, seed: int, actions: Sequence[str]) -> dict[str, Path]:
    """Collect the tables of one kind that are missing or were interrupted; return them by action."""
    tables = {}
    for action in actions:
        tables[action] = table = options.out / kind / f"{action}.parquet"
        if table.exists() and read_experience(table).metadata.get("complete", False):
            continue
        print(f"study: {kind} of {action}", flush=True)
        words = [*_setting(options), "--action-set", options.action_set, "--actions", action]
        words += [
            "--episodes",
            str(options.episodes),
            "--seed",
            str(options.seed + seed),
            "--out",
            str(table),
        ]
        parsed, domain = settled(collect.arguments(), words)
        code = collecting.run(parsed, domain, f"collect of study, seed {options.seed + seed}")
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        if code:
            raise EvaluationError(
                f"{table}: expected a whole table of experience, the collection has ended early"
            )
    return tables


def _trained(
    options: argparse.Namespace,
    source: ToolsetSource,
    tables: Mapping[str, Mapping[str, Path]],
    actions: Sequence[str],
) -> None:
    if all((source.folder() / f"{action}.json").exists() for action in actions):
        return
    print("study: models", flush=True)
    words = [str(table) for table in tables["experience"].values()]
    words += ["--fresh", *map(str, tables["fresh"].values()), "--models", source.models]
    words += ["--no-gate", *_setting(options)[:2]] + (["--robot", options.robot] if options.robot else [])
    parsed, domain = settled(train.arguments(), words)
    training.run(parsed, domain, "train of study")


def _evaluated(options: argparse.Namespace, source: ToolsetSource, chain: str) -> dict[str, Any]:
    """Learn the gate and evaluate, as far as this has not been done; return the summary."""
    common = [*_setting(options), "--action-set", options.action_set, "--models", source.models]
    common += ["--situations", str(options.situations), "--chain", chain]
    if not (source.folder() / GATE).exists():
        print("study: gate", flush=True)
        words = [*common, "--seed", str(options.seed + 2), "--work", str(options.out / "gate")]
        words += ["--room", "--calibrate", "--draw-errors"]
        gating.run(settled(gate.arguments(), words)[0], "gate of study")
    folder = options.out / "evaluation"
    if not (folder / RESULT).exists():
        print("study: evaluation", flush=True)
        words = [*common, "--seed", str(options.seed + 3), "--out", str(folder), "--policies", *POLICIES]
        words += ["--oracle", str(options.oracle), "--oracle-margin", MARGIN_S]
        evaluating.run(settled(evaluate.arguments(), words)[0], "evaluate of study")
    summary: dict[str, Any] = read_result(folder / RESULT)["summary"]
    return summary


def _variables(options: argparse.Namespace, source: ToolsetSource, chain: str) -> tuple[OpenVariable, ...]:
    """Explain what each open variable of the chain is worth, in situations of the evaluation."""
    tools, library = tools_of(source)
    trials = [
        random_trial(tools.domain, chain, library, seed=options.seed + 3, index=index)
        for index in range(min(options.situations, EXPLAINED))
    ]
    found = open_variables(tools, trials)
    for each in found:
        print(f"study: step {each.step} ({each.top}), {each.name}: {each.explanation}")
    return found


def _measured(
    options: argparse.Namespace, action: str, source: ToolsetSource, robot: Robot
) -> MeasuredAction:
    kinds = [options.out / kind / f"{action}.parquet" for kind in ("experience", "fresh")]
    tables = [read_experience(table).frame for table in kinds]
    ends = join(table.drop_duplicates("episode", keep="last") for table in tables)
    done = ends[ends["success"]]
    file, features = source.folder() / f"{action}.json", find_domain(options.domain).known_features
    failures = ends.loc[~ends["success"], "reason"].value_counts()
    return MeasuredAction(
        episodes=len(ends),
        success=round(len(done) / len(ends), 5),
        mean_duration_s=round(float(done["duration"].mean()), 3) if len(done) else None,
        accuracy=load_model(file, robot, features).metadata["accuracy"] if file.exists() else {},
        failures={str(why): int(count) for why, count in failures.items()},
    )
