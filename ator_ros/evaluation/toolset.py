"""Robot and models from which policies choose, read from files."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.domains import DEFAULT
from ator_ros.domains.available_models import models_for
from ator_ros.domains.domain import Domain, DomainError, find_domain
from ator_ros.domains.trials import random_trial
from ator_ros.performance.model_file import load_model, models_folder
from ator_ros.performance.path_times import path_times_remark
from ator_ros.refinement.chain_prediction import ChainPrediction, PredictsPerformance, predict_chain
from ator_ros.refinement.gate import NO_GATE, Gate
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World


@dataclass(frozen=True)
class Toolset:
    """The performance models of the policies.

    Attributes
    ----------
    domain : Domain
    robot : Robot
    models : mapping of str to PredictsPerformance
        Models by the name of the action.
    """

    domain: Domain
    robot: Robot
    models: Mapping[str, PredictsPerformance]

    @property
    def remark(self) -> str:
        """Which actions have path times instead of a learned model; empty if none."""
        learned = {name: getattr(model, "is_learned", True) for name, model in self.models.items()}
        return path_times_remark(name for name, is_learned in learned.items() if not is_learned)

    def refiner(self, *, gated: bool = False) -> Refiner:
        """Return a refiner with these models, with the gate if `gated`."""
        gate = Gate() if gated else NO_GATE
        ranges = self.domain.ranges
        cost = self.domain.time_limit
        return Refiner(self.robot, self.models, gate, ranges=ranges, failure_cost=cost)

    def predict(self, world: World, chain: TopChain) -> ChainPrediction:
        """Return the prediction of a chain with its own values; durations are in s."""
        return predict_chain(world, chain, self.models, self.robot)


@dataclass(frozen=True, kw_only=True)
class ToolsetSource:
    """Source of robot, actions and models.

    Attributes
    ----------
    domain : str
        Name or file of the domain.
    robot : str
        File of the robot's description; empty: the shipped one.
    map : str
        File of the building's map; empty: the domain's, if it has one.
    action_set : str
        Name of one of the domain's action sets.
    models : str
        Folder with the layout of the shipped models/; empty: the shipped folder.
    """

    domain: str = DEFAULT
    robot: str = ""
    map: str = ""
    action_set: str = DEFAULT_SET
    models: str = ""

    def in_domain(self) -> Domain:
        """Return the domain, on the map."""
        return find_domain(self.domain).on_map(self.map)

    def described(self) -> Robot:
        """Return the robot."""
        return self.in_domain().robot(self.robot or None)

    def models_root(self) -> Path:
        """Return the folder of the models of all action sets."""
        return self.in_domain().models_root(self.models)

    def folder(self) -> Path:
        """Return the folder of the model files of the action set."""
        return models_folder(self.models_root(), self.action_set)

    def digest(self) -> str:
        """Return a digest of the robot's description and of all model files."""
        sha = hashlib.sha256(self.described().description_digest().encode())
        for file in sorted(self.folder().glob("*.json")):
            sha.update(file.name.encode() + file.read_bytes())
        return sha.hexdigest()[:16]

    def require_executable(self, chain: str) -> None:
        """Check the actions of a chain and their models.

        Raises
        ------
        DomainError
            The simulator cannot execute an action.
        FileError
            A model cannot be used.
        """
        domain = self.in_domain()
        robot = self.described()
        library = domain.library(robot, self.action_set)
        trial = random_trial(domain, chain, library, seed=0, index=0)
        specs = domain.actions(self.action_set)
        for action in dict.fromkeys(call.top.action for call in trial.chain.calls):
            if why := specs[action].over_ros_only:
                raise DomainError(f"chain {chain}: {why}")
            file = self.folder() / f"{action}.json"
            if file.exists():
                load_model(file, robot, domain.known_features)


def tools_of(source: ToolsetSource) -> tuple[Toolset, TopLibrary]:
    """Return toolset and library, cached until a file changes.

    Raises FileError for a model that cannot be used.
    """
    return _loaded(source, source.digest())


@lru_cache(maxsize=4)
def _loaded(source: ToolsetSource, _digest: str) -> tuple[Toolset, TopLibrary]:
    domain = source.in_domain()
    robot = source.described()
    action_set = source.action_set
    models = models_for(domain, robot, action_set=action_set, folder=source.models)
    return Toolset(domain, robot, models), domain.library(robot, action_set)
