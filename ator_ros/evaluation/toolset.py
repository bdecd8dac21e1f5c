"""Toolsets of policies, read from model files and, if given, tables of experience."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains import DEFAULT
from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.ceiling import BoostedTime, ideal_times, plain_times
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.heuristics import arriving, bitbots, booster, load_baselines
from ator_ros.evaluation.policies import OBSERVED, POLICIES, Models, Toolset
from ator_ros.evaluation.trials import random_trial
from ator_ros.experience.table import join, read_experience
from ator_ros.performance.features import PATHS
from ator_ros.performance.model_file import load_model, model_path
from ator_ros.refinement.calibration import CALIBRATION, load_calibration_if_any, model_digest
from ator_ros.refinement.gate import GATE, gate_in
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary

BASELINES = "baselines.json"
BOOSTING = "hist_gradient_boosting"
"""The policy that learns from a table of experience instead of model files."""


@dataclass(frozen=True, kw_only=True)
class ToolsetSource:
    """Source of robot, actions, models and gate.

    Attributes
    ----------
    domain : str
        Name of the domain.
    robot : str
        File of the robot's description; empty: the shipped one.
    action_set : str
        Name of one of its action sets.
    models : str
        Folder of the models, with the layout of the shipped models/; empty: the shipped folder.
    experience : tuple of str
        Tables to which gradient boosting is fitted; empty: no such models.
    """

    domain: str = DEFAULT
    robot: str = ""
    action_set: str = DEFAULT_SET
    models: str = ""
    experience: tuple[str, ...] = ()

    def described(self) -> Robot:
        """Return the robot."""
        return find_domain(self.domain).robot(self.robot or None)

    def folder(self) -> Path:
        """Return the folder of the model files."""
        return self._top() / model_path("gate", self.action_set).parent

    def observed_folder(self) -> Path:
        """Return the folder of the models that know nothing but what was observed."""
        return self._top() / OBSERVED / model_path("gate", self.action_set).parent

    def _top(self) -> Path:
        return Path(self.models) if self.models else find_domain(self.domain).shipped_models

    def digest(self, policies: Iterable[str], chain: str) -> str:
        """Return a digest of the robot's description and of all files that the choices depend on."""
        robot = self.described()
        sha = hashlib.sha256(robot.description_digest().encode())
        names = [f"{action}.json" for action in self.actions_of(chain, robot)] + [CALIBRATION]
        names += [GATE] if any(policy.startswith(("refined", "gated")) for policy in policies) else []
        names += [BASELINES] if any(policy.endswith("refitted") for policy in policies) else []
        files = [self.folder() / name for name in names]
        if any(policy.startswith(OBSERVED) for policy in policies):
            models = [f"{action}.json" for action in self.actions_of(chain, robot)]
            files += [self.observed_folder() / name for name in (*models, GATE)]
        for file in [*files, *map(Path, self.experience)]:
            sha.update(file.read_bytes() if file.exists() else b"none")
        return sha.hexdigest()[:16]

    def digests(self, chain: str) -> dict[str, str]:
        """Return the digests of the robot and of the learned models of a chain's actions.

        Raises
        ------
        ModelFileError
            A model cannot be used.
        """
        robot, features = self.described(), find_domain(self.domain).known_features
        files = {action: self.folder() / f"{action}.json" for action in self.actions_of(chain, robot)}
        models = {action: model_digest(load_model(file, robot, features)) for action, file in files.items()}
        return {"robot": robot.digest(), **models}

    def require_executable(self, chain: str) -> None:
        """Raise EvaluationError where the simulator cannot execute an action of a chain."""
        specs = find_domain(self.domain).actions(self.action_set)
        reasons = (specs[action].over_ros_only for action in self.actions_of(chain, self.described()))
        why = next((reason for reason in reasons if reason is not None), None)
        if why is not None:
            raise EvaluationError(f"chain {chain}: {why}")

    def stamps(self) -> tuple[tuple[str, int, int], ...]:
        """Return name, time of change in ns, and size of models, gates, experience and a robot's own file."""
        folders = (self.folder(), self.observed_folder())
        files = [file for folder in folders for file in sorted(folder.glob("*.json"))]
        files += [Path(name) for name in (self.robot, *self.experience) if name]
        stamps = []
        for file in files:
            with suppress(FileNotFoundError):
                stat = file.stat()
                stamps.append((str(file), stat.st_mtime_ns, stat.st_size))
        return tuple(stamps)

    def actions_of(self, chain: str, robot: Robot) -> list[str]:
        """Return the action of each step of a chain."""
        trial = random_trial(find_domain(self.domain), chain, make_library(robot, self), seed=0, index=0)
        return [call.top.action for call in trial.chain.calls]


def read_rows(tables: Iterable[Path | str]) -> dict[str, pd.DataFrame]:
    """Read tables of experience; return their rows by action.

    Raises
    ------
    ExperienceError
        A table cannot be used.
    """
    frame = join(read_experience(table).frame for table in tables)
    return {str(action): rows for action, rows in frame.groupby("action", sort=False)}


def available_policies(source: ToolsetSource) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the policies that the existing files allow, and what each of the others lacks."""
    missing: dict[str, str] = {}
    if not (source.folder() / BASELINES).exists():
        why = f"{source.folder() / BASELINES} is not there; `gate --experience FILE` makes it"
        missing |= {"bitbots_refitted": why, "booster_refitted": why}
    if not (source.folder() / GATE).exists():
        why = f"{source.folder() / GATE} is not there; the tool `gate` makes it"
        missing |= {"gated": why, "gated_speed": why}
    if not any(source.observed_folder().glob("*.json")):
        why = f"{source.observed_folder()} has no models; `train --observed` makes them"
        missing |= {OBSERVED: why, f"{OBSERVED}_speed": why}
    if not source.experience:
        missing[BOOSTING] = "it needs the table of experience: --experience FILE"
    return tuple(name for name in POLICIES if name not in missing), missing


def without_experience(tools: Toolset, source: ToolsetSource, chain: str) -> dict[str, str]:
    """Return the policies that experience lacks an action of a chain for, and which it lacks."""
    if BOOSTING not in tools.models:
        return {}
    there = tools.models[BOOSTING]
    lacking = [action for action in source.actions_of(chain, tools.robot) if action not in there]
    return {BOOSTING: f"no table of --experience has {lacking[0]}"} if lacking else {}


def make_library(robot: Robot, source: ToolsetSource) -> TopLibrary:
    """Return the TOP library with the source's action set."""
    return find_domain(source.domain).library(robot, source.action_set)


def _files(folder: Path, actions: Iterable[str]) -> dict[str, Path]:
    """Return the existing model files; if there are none, all that are expected, for the error message."""
    files = {action: folder / f"{action}.json" for action in actions}
    return {action: file for action, file in files.items() if os.path.lexists(file)} or files


def make_toolset(source: ToolsetSource) -> Toolset:
    """Read models and gate, and fit gradient boosting.

    Raises
    ------
    ModelFileError, RefinementError, ExperienceError, EvaluationError
        An existing file cannot be used; the message names it.
    """
    domain, robot, folder = find_domain(source.domain), source.described(), source.folder()
    actions, features = list(domain.actions(source.action_set)), domain.known_features
    headed, files = arriving(domain.tops), _files(folder, list(domain.actions(source.action_set)))
    models: dict[str, Models] = {
        "learned": {action: load_model(file, robot, features) for action, file in files.items()},
        "bitbots": {action: bitbots(robot, arrives=action in headed) for action in actions},
        "booster": {action: booster(robot, arrives=action in headed) for action in actions},
        "ideal_time": ideal_times(domain, robot, source.action_set),
        "turn_drive_turn": plain_times(domain, robot, source.action_set),
    }
    if (folder / BASELINES).exists():
        models |= load_baselines(folder / BASELINES, robot)
    if source.experience:
        described = tuple(feature for feature in features.values() if feature not in PATHS)
        models[BOOSTING] = {
            action: BoostedTime(robot, described).fit(rows)
            for action, rows in read_rows(source.experience).items()
        }
    observed = source.observed_folder()
    if any(observed.glob("*.json")):
        models[OBSERVED] = {
            action: load_model(file, robot, features)
            for action in actions
            if (file := observed / f"{action}.json").exists()
        }
    gates = {OBSERVED: gate_in(observed, source.action_set)}
    gate = gate_in(folder, source.action_set)
    return Toolset(domain, robot, models, gate, load_calibration_if_any(folder), gates)


def tools_of(source: ToolsetSource) -> tuple[Toolset, TopLibrary]:
    """Return toolset and library, made once per process, and again after a file of the source has changed."""
    return _made(source, source.stamps())


@lru_cache(maxsize=4)
def _made(source: ToolsetSource, _stamps: tuple[tuple[str, int, int], ...]) -> tuple[Toolset, TopLibrary]:
    tools = make_toolset(source)
    return tools, make_library(tools.robot, source)
