"""Learn performance models from experience; print rules and accuracy (paper, sections 3, 5)."""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import NEAR_GOAL
from ator_ros.domains.domain import Domain
from ator_ros.experience.drives import CMD_VEL
from ator_ros.experience.recordings import read_sources
from ator_ros.experience.server_drives import ODOM
from ator_ros.experience.table import Experience, ExperienceError, library_versions
from ator_ros.files import FileError, is_name
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.performance.accuracy import accuracy, brier, kinds
from ator_ros.performance.coverage import unvaried
from ator_ros.performance.held_up import held_up_remark
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_model, model_path, save_model
from ator_ros.performance.path_times import few_drives_remark
from ator_ros.performance.training import (
    WorseThanMeanError,
    digest,
    start_ranges,
    without_errors,
    without_routes,
)
from ator_ros.performance.training import train as train_model
from ator_ros.printable import one_line, printable
from ator_ros.tools.command_line import add_nav2, add_setting, run_tool

_FORCE = "--force"
_ROLES = {ODOM: "odometry", CMD_VEL: "velocity commands"}


def train(
    experience: Sequence[Path],
    folder: Path,
    *,
    command: str,
    fresh: Sequence[Path] = (),
    domain: Domain,
    robot: Robot,
    action_set: str | None = None,
    topics: Mapping[str, str] | None = None,
    force: bool = False,
) -> None:
    """Learn a model of each action in `experience`, and write it to `folder`.

    `experience` and `fresh` are tables or recordings; accuracy is measured on `fresh`. `command` is
    the command line for the files. With `force`, models that predict worse than the mean duration
    are written, too. The other parameters are those of `read_sources`.
    """
    read = read_sources(experience, robot, domain, action_set, topics)
    action_set = read.metadata["action_set"]
    tests = Experience(read.frame[:0], {})
    if fresh:
        tests = read_sources(fresh, robot, domain, action_set, topics)
    for remark in (*read.remarks, *tests.remarks):
        print(f"train: {one_line(remark)}", file=sys.stderr)
    errors: list[str] = []
    learned = 0
    for action, examples in read.frame.groupby("action", sort=False):
        features = domain.candidates(action, action_set)
        # Recordings rarely contain enough episodes of every action: save each model once it is
        # learned.
        try:
            model = train_model(
                action,
                examples,
                robot,
                features=features,
                better_than_mean=not force,
            )
        except WorseThanMeanError as error:
            errors.append(f"{error} Not written; {_FORCE} writes it")
            continue
        except ExperienceError as error:
            errors.append(str(error))
            continue
        learned += 1
        remarks = [f"{action}{text}" for text in without_routes(examples, robot, features)]
        remarks += held_up_remark(action, model.held_up)
        remarks += few_drives_remark(model)
        if any(top.arrives for top in domain.tops if top.action == action):
            remarks += unvaried(model)
        for remark in (*without_errors(action, examples), *remarks):
            print(f"train: {one_line(remark)}", file=sys.stderr)
        starts = tests.frame[(tests.frame["action"] == action) & (tests.frame["t"] == 0.0)]
        measured = _measured(model, starts, tests.metadata.get("seed") or 0) if len(starts) else {}
        training = {
            "seed": read.metadata.get("seed"),
            "command": read.metadata.get("command"),
            "digest": digest(examples),
            "episodes": int(examples["episode"].nunique()),
            "examples": len(examples),
            "starts": start_ranges(examples, robot),
            "train_command": command,
        }
        if robot.grid is not None:
            training["map"] = str(robot.grid)
        metadata = {
            "action_set": action_set,
            "training": training,
            "versions": library_versions(),
            "accuracy": measured,
        }
        file = folder / model_path(action, action_set)
        save_model(file, dataclasses.replace(model, metadata=metadata))
        print(f"{printable(file, 300)}: {_summary(model, examples, measured)}", flush=True)
    if not learned:
        raise ExperienceError("; ".join(errors))
    for message in errors:
        print(f"train: {message}; the models of other actions are written", file=sys.stderr)


def _summary(model: PerformanceModel, examples: pd.DataFrame, measured: Mapping[str, Any]) -> str:
    """Return the size of a model and its error, on fresh episodes or by cross-validation."""
    leaves = model.trees["duration"].n_leaves
    rules = f"{leaves} rule{'s' if leaves > 1 else ''} with {len(model.used_features)} features"
    if "mae_s" in measured:
        errors = f"MAE {measured['mae_s']:.3f} s, RMSE {measured['rmse_s']:.3f} s"
        return f"{rules}, {errors} on {measured['episodes']} fresh episodes from rest"
    if measured or model.errors is None:
        return rules
    absolute = np.abs(model.errors.errors)
    counted = f"{len(absolute)} drives"
    succeeded = int((examples["success"] & (examples["t"] == 0.0)).sum())
    succeeded -= model.held_up.drives
    if len(absolute) < succeeded:
        counted += f" of {succeeded} (others are below {NEAR_GOAL} m or lack a route)"
    return f"{rules}, MAE {absolute.mean():.3f} s by cross-validation on {counted}"


def _measured(model: PerformanceModel, starts: pd.DataFrame, seed: int) -> dict[str, Any]:
    """Return the accuracy for starts at rest (for all if none is), and for each other kind."""
    parts = {
        name: accuracy(model, part, seed=seed)
        for name, part in kinds(starts, model.robot).items()
        if part["success"].any()
    }
    measured = parts.pop("at rest", None)
    if measured is None:
        measured = accuracy(model, starts, seed=seed) if starts["success"].any() else {}
    return {**measured, "kinds": parts, "success": brier(model, starts, seed=seed)}


def _rules(domain: Domain, options: argparse.Namespace, robot: Robot, folder: Path) -> str:
    """Return the rules of a model, which is named by its action or file."""
    file = Path(options.rules)
    if file.suffix != ".json":
        if not is_name(options.rules):
            raise FileError(
                f"--rules: expected an action or a model, a .json file, got {options.rules!r}"
            )
        file = folder / model_path(options.rules, options.action_set or DEFAULT_SET)
    if not file.exists():
        models = ", ".join(sorted(other.stem for other in file.parent.glob("*.json")))
        raise FileError(
            f"{file}: expected a model, there is none; in that folder: {models or 'none'}"
        )
    return load_model(file, robot, domain.known_features).rules("duration")


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `train`."""
    parser = argparse.ArgumentParser(prog="train", description=__doc__)
    parser.add_argument(
        "experience", nargs="*", type=Path,
        help="tables of collect, or recordings (.mcap, .db3, folders)",
    )  # fmt: skip
    parser.add_argument(
        "--fresh", nargs="+", type=Path, default=[],
        help="other episodes, on which accuracy is measured",
    )  # fmt: skip
    add_setting(parser, action_set=False)
    add_nav2(parser)
    parser.add_argument(
        "--planner", type=_topic, metavar="ACTION",
        help="running action server of nav2_msgs/ComputePathToPose, whose paths are the routes on "
        "the map",
    )  # fmt: skip
    parser.add_argument(
        "--frame", default="map", help="of the map, for the planner (default: %(default)s)"
    )
    parser.add_argument(
        "--models", type=Path, help="folder of the models (default: the shipped models/)"
    )
    parser.add_argument(
        "--action-set", metavar="NAME",
        help="of recorded odometry and commands (tables and records contain theirs)",
    )  # fmt: skip
    for role, what in _ROLES.items():
        parser.add_argument(
            f"--{role.replace('_', '-')}", type=_topic, metavar="TOPIC",
            help=f"of {what} in recordings (default: {role} in any namespace)",
        )  # fmt: skip
    parser.add_argument(
        _FORCE, action="store_true",
        help="also write models that predict worse than the mean duration",
    )  # fmt: skip
    parser.add_argument(
        "--rules", metavar="MODEL",
        help="only print the rules of a model, named by its action or file",
    )  # fmt: skip
    return parser


def _topic(text: str) -> str:
    """Return the absolute name of a topic or action; an argparse type."""
    return f"/{text.removeprefix('/')}"


def _run(options: argparse.Namespace, domain: Domain, command: str) -> None:
    if options.planner is None:
        _train(options, domain, command)
        return
    import rclpy

    from ator_ros.nodes.path_planner import planned_by

    if domain.grid is None:
        raise FileError("--planner: expected a map, too; add --map")
    stay_on_this_machine(os.environ)
    rclpy.init()
    try:
        try:
            domain = planned_by(options.planner, options.frame, domain)
        except ValueError as error:  # a RemoteError, or rclpy's of a name
            raise FileError(f"--planner: {error}") from error
        _train(options, domain, command)
    finally:
        rclpy.try_shutdown()


def _train(options: argparse.Namespace, domain: Domain, command: str) -> None:
    robot = domain.robot(options.robot or None)
    folder = domain.models_root(options.models)
    if options.rules:
        print(_rules(domain, options, robot, folder))
        return
    if not options.experience:
        raise ExperienceError("expected experience to learn from, or --rules")
    if options.models is None and robot.digest() != domain.robot(None).digest():
        raise ExperienceError(
            f"--models: expected a folder for models of {robot.name}; the shipped models are "
            "another robot's"
        )
    given = {role: getattr(options, role) for role in _ROLES}
    train(
        options.experience,
        folder,
        command=command,
        fresh=options.fresh,
        domain=domain,
        robot=robot,
        action_set=options.action_set,
        topics={role: name for role, name in given.items() if name is not None},
        force=options.force,
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return run_tool(
        arguments(), _run, argv, interrupted="the models printed above were written, no others"
    )
