"""Learn performance models and the gate from experience; show rules and accuracy (paper, sections 3, 5)."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.evaluation.gate_from_episodes import gate_of_episodes
from ator_ros.evaluation.trials import possible_chain
from ator_ros.experience.columns import LARGEST
from ator_ros.experience.recordings import USUAL, TopicNames
from ator_ros.experience.sources import read_sources
from ator_ros.experience.table import Experience, library_versions
from ator_ros.files import is_name, portable_command
from ator_ros.performance.accuracy import accuracy, brier, kinds
from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.performance.features import OBSERVED, Feature, chosen_for
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import ModelFileError, is_model, load_model, model_path, save_model
from ator_ros.performance.training import (
    TrainingError,
    cross_validated_errors,
    digest,
    observed_starts,
    start_ranges,
)
from ator_ros.performance.training import train as train_model
from ator_ros.refinement.gate import save_gate
from ator_ros.robot.description import ConfigError, Robot
from ator_ros.tools.command_line import add_setting, guarded, parse, topic

_GATE_SEED, _GATE_SITUATIONS = 1, 60
"""Seed and number of the situations in which the gate is learned."""


def train(
    experience: Sequence[Path],
    folder: Path,
    *,
    command: str,
    fresh: Sequence[Path] = (),
    domain: Domain,
    robot: Robot,
    action_set: str | None = None,
    topics: TopicNames = USUAL,
    observed: bool = False,
    gate: bool = True,
) -> None:
    """Learn a model of each action in the experience, and the gate, and write them.

    Parameters
    ----------
    experience, fresh : sequence of Path
        Tables or recordings to learn from, and to measure accuracy on.
    folder : Path
        Of the models.
    command : str
        The command line, for the files.
    domain, robot
        The domain and its robot.
    action_set : str, optional
        Action set of recorded odometry and commands; tables and records name their own.
    topics : TopicNames
        Of odometry and commands in recordings.
    observed : bool
        Learn from odometry, goals and results alone.
    gate : bool
        Learn the gate from the same episodes.
    """
    read = _read(domain, experience, robot, action_set, topics)
    rows, source = read.frame, read.metadata
    tests = Experience(rows[:0], {})
    if fresh:
        tests = _read(domain, fresh, robot, source["action_set"], topics)
    by_action = dict(iter(rows.groupby("action", sort=False)))
    errors: list[str] = []
    used: dict[str, tuple[Feature, ...]] = {}
    for action, examples in by_action.items():
        if observed:
            features = (*OBSERVED, *domain.goal_features(action, source["action_set"]))
        else:
            features = _suited(domain.candidates(action, source["action_set"]), robot, domain)
        # A recording rarely holds enough episodes of every action. Each model is saved once it is learned.
        try:
            model = train_model(action, examples, robot, features=features)
        except TrainingError as error:
            errors.append(str(error))
            continue
        used[action] = features
        own = tests.frame[tests.frame["action"] == action]
        measured = _measure(model, own, tests.seed) if len(own) else {}
        found = _summary(model, measured) if measured else _validated(model, examples, robot, features)
        training = {
            "seed": source.get("seed"),
            "command": source.get("command"),
            "digest": digest(examples),
            "episodes": int(examples["episode"].nunique()),
            "examples": len(examples),
            "starts": (observed_starts if observed else start_ranges)(examples, robot),
            "train_command": command,
        }
        metadata = {
            "action_set": source["action_set"],
            "training": training,
            "versions": library_versions(),
            "accuracy": measured,
        }
        file = folder / model_path(action, source["action_set"])
        save_model(file, dataclasses.replace(model, metadata=metadata))
        print(f"{file}: {found}", flush=True)
    if len(errors) == len(by_action):
        raise TrainingError("; ".join(errors))
    for missing in errors:
        print(f"train: {missing}; the other actions are learned", file=sys.stderr)
    if gate:
        _learn_gate(
            domain,
            robot,
            folder / model_path("gate", source["action_set"]),
            action_set=source["action_set"],
            rows={name: by_action[name] for name in used},
            features=used,
            command=command,
        )


def _learn_gate(
    domain: Domain,
    robot: Robot,
    file: Path,
    *,
    action_set: str,
    rows: Mapping[str, pd.DataFrame],
    features: Mapping[str, tuple[Feature, ...]],
    command: str,
) -> None:
    """Learn the gate from the episodes of the models; report the reason if that is not possible."""
    library = domain.library(robot, action_set)
    try:
        chain = possible_chain(domain, library, None, list(rows))
        if chain is None:
            raise TrainingError(f"domain {domain.name} has no chain with only {', '.join(rows)}")
        print(f"train: learning the gate in {_GATE_SITUATIONS} situations of the chain {chain} …", flush=True)
        gate, learned = gate_of_episodes(
            domain, library, rows, chain, seed=_GATE_SEED, situations=_GATE_SITUATIONS, features=features
        )
    except (TrainingError, ConfigError) as error:
        result = f"{file} stays as it is" if file.exists() else "refinement accepts every predicted gain"
        print(f"{file.parent}: no gate: {error}; {result}")
        return
    training = learned.training(command=command, seed=_GATE_SEED, situations=_GATE_SITUATIONS)
    save_gate(file, gate, training, action_set)
    spread = (
        f" + {gate.spread_factor:g} times the spread of the two predictions" if gate.spread_factor else ""
    )
    print(f"{file}: refines where the predicted gain is above {gate.gain:.2f} s{spread}")


def _is_own(robot: Robot, domain: Domain) -> bool:
    """Return whether a robot is the domain's own, for which models ship."""
    return robot.digest() == domain.robot(None).digest()


def _suited(features: tuple[Feature, ...], robot: Robot, domain: Domain) -> tuple[Feature, ...]:
    """Return the features with kinds of ideal motions that suit a robot other than the domain's own."""
    if _is_own(robot, domain) or not any(each.motions for each in features):
        return features
    return chosen_for(features, robot)


def _read(
    domain: Domain, paths: Sequence[Path], robot: Robot, action_set: str | None, topics: TopicNames
) -> Experience:
    experience = read_sources(paths, robot, domain, action_set, topics)
    for remark in experience.remarks:
        print(f"train: {remark}", file=sys.stderr)
    if left_out := experience.metadata["records_left_out"]:
        print(f"train: left out {left_out} records that cannot be used", file=sys.stderr)
    return experience


def _measure(model: PerformanceModel, fresh: pd.DataFrame, seed: int) -> dict[str, Any]:
    starts = fresh[fresh["t"] == 0.0]
    parts = {
        name: accuracy(model, part, seed=seed)
        for name, part in kinds(starts, model.robot)
        if part["success"].any()
    }
    measured = parts.pop("at rest", None)
    if measured is None:
        measured = accuracy(model, starts, seed=seed) if starts["success"].any() else {}
    return {**measured, "kinds": parts, "success": brier(model, starts, seed=seed)}


def _summary(model: PerformanceModel, measured: dict[str, Any]) -> str:
    tree = model.trees["duration"]
    rules = "1 rule" if tree.n_leaves == 1 else f"{tree.n_leaves} rules"
    text = f"{rules} with {len(model.used_features)} features"
    if measured:
        text += (
            f", MAE {measured['mae_s']:.3f} s, RMSE {measured['rmse_s']:.3f} s on {measured['episodes']} "
            f"fresh episodes from rest"
        )
    return text


def _validated(
    model: PerformanceModel, examples: pd.DataFrame, robot: Robot, features: Sequence[Feature]
) -> str:
    """Return the summary with the accuracy by cross-validation on the training drives."""
    errors = np.abs(cross_validated_errors(examples, robot, features))
    return f"{_summary(model, {})}, MAE {errors.mean():.3f} s by cross-validation on {len(errors)} drives"


def _rules(domain: Domain, options: argparse.Namespace, robot: Robot, folder: Path) -> str:
    by_file = options.rules.endswith(".json")
    file = Path(options.rules)
    if not by_file and not is_name(options.rules):
        raise ModelFileError(f"--rules: expected an action or a model, a .json file, got {options.rules!r}")
    if not by_file:
        file = folder / model_path(options.rules, options.action_set or DEFAULT_SET)
    if not file.exists():
        there = ", ".join(sorted(other.stem for other in file.parent.glob("*.json") if is_model(other)))
        raise ModelFileError(f"{file}: expected a model, there is none; in that folder: {there or 'none'}")
    model = load_model(file, robot, domain.known_features)
    if options.measure not in model.trees:
        raise ModelFileError(f"measure: expected one of {', '.join(model.trees)}, got {options.measure!r}")
    if not options.situation:
        return model.rules(options.measure)
    names = (*DIRECT_VARIABLES, *model.declared_variables)
    return model.explain(_situation(options.situation, names), options.measure)


def _situation(words: Sequence[str], names: Sequence[str]) -> dict[str, float]:
    """Read NAME=NUMBER words; direct variables that are not named are 0."""
    situation = dict.fromkeys(names, 0.0)
    for word in words:
        name, _, value = word.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if name not in situation or not abs(number) <= LARGEST:
            raise TrainingError(
                f"situation: expected NAME=NUMBER with a name of {', '.join(names)} "
                f"and a number up to {LARGEST:g}, got {word[:80]!r}"
            )
        situation[name] = number
    return situation


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `train`."""
    parser = argparse.ArgumentParser(prog="train", description=__doc__)
    parser.add_argument(
        "experience", nargs="*", type=Path, help="tables of collect, or recordings (.mcap or their folders)"
    )
    parser.add_argument(
        "--fresh",
        nargs="+",
        type=Path,
        default=[],
        help="other episodes, on which accuracy is measured",
    )
    add_setting(parser, action_set=False)
    parser.add_argument("--models", type=Path, help="folder of the models (default: the shipped models/)")
    parser.add_argument(
        "--action-set",
        metavar="NAME",
        help="of odometry and commands that were recorded (tables and records know their own)",
    )
    parser.add_argument(
        "--no-gate",
        action="store_true",
        help="do not learn the gate from the same episodes (`gate` learns one from executed chains)",
    )
    parser.add_argument(
        "--odom", type=topic, metavar="TOPIC",
        help="of odometry in recordings (default: odom in any namespace)",
    )  # fmt: skip
    parser.add_argument(
        "--cmd-vel", type=topic, metavar="TOPIC",
        help="of velocity commands in recordings (default: cmd_vel in any namespace)",
    )  # fmt: skip
    parser.add_argument(
        "--rules",
        metavar="MODEL",
        help="print the rules of a model, given by its action or file, and stop",
    )
    parser.add_argument(
        "--observed",
        action="store_true",
        help="learn from odometry, goals and results alone, without ideal times of our own actions",
    )
    parser.add_argument("--measure", default="duration", help="whose rules (default: %(default)s)")
    parser.add_argument(
        "--situation", nargs="+", metavar="NAME=VALUE",
        help="with --rules: only the rule for one situation, of direct variables such as xg=1.5 yawg=1.57; "
        "angles in rad",
    )  # fmt: skip
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = arguments()
    options, domain = parse(parser, words)
    if not (options.experience or options.rules):
        parser.error("expected experience to learn from, or --rules")

    def run() -> None:
        robot = domain.robot(options.robot or None)
        folder = options.models if options.models is not None else domain.shipped_models
        if options.rules:
            print(_rules(domain, options, robot, folder))
            return
        if options.models is None and not _is_own(robot, domain):
            raise TrainingError(
                f"--models: expected a folder for models of {robot.name}; those that ship are another robot's"
            )
        train(
            options.experience,
            folder,
            command=portable_command("train", words),
            fresh=options.fresh,
            domain=domain,
            robot=robot,
            action_set=options.action_set,
            topics=TopicNames(options.odom or USUAL.odom, options.cmd_vel or USUAL.cmd_vel),
            observed=options.observed,
            gate=not options.no_gate,
        )

    return guarded("train", run, interrupted="models whose lines were printed are written, no others")


if __name__ == "__main__":
    sys.exit(main())
