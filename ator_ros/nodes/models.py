"""The models of each action set: read at the start, replaced by learned sets, for refiners and predictors."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from rclpy.node import Node

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor, warm_up_actions, warm_up_refinement
from ator_ros.files import FileError
from ator_ros.learning.sets import Manifest, current_set, read_manifest
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.parameters import Parameter
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import (
    NoModelsError,
    RobotMismatchWarning,
    load_models,
    models_folder,
)
from ator_ros.refinement.gate import Gate, OpenGate, gate_in
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary

LEARNED = Parameter(
    "learned",
    "",
    "folder of the node `learning`: its set in use replaces `models` once there is one; empty: none",
)
_PERIOD = 0.5

User = TypeVar("User")
Libraries = Mapping[str, TopLibrary]


@dataclass(frozen=True, slots=True)
class ModelSet:
    """The performance models of one action set, by action.

    `absent` is why there are none. `problem` is what is wrong: a damaged file, another robot. It is no
    problem to have none.
    """

    models: Mapping[str, PerformanceModel] = field(default_factory=dict)
    absent: str = ""
    problem: str = ""


@dataclass(frozen=True)
class Loaded(Generic[User]):
    """The models of one folder, and what uses them (a predictor or a refiner), by action set."""

    models: Mapping[str, ModelSet]
    by_set: Mapping[str, User]


def read_models(node: Node, robot: Robot, action_set: str, place: Path, domain: Domain) -> ModelSet:
    """Read the models of an action set from the folder of all sets; log what is wrong.

    Of sets beside the default one, which are seldom used, only damaged files are logged.
    """
    warn = node.get_logger().warning
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RobotMismatchWarning)
            models = load_models(robot, domain.known_features, action_set=action_set, folder=place)
    except NoModelsError as error:
        return ModelSet(absent=str(error))
    except (FileError, OSError) as error:
        warn(f"action set {action_set}: no models: {error}")
        return ModelSet(absent=str(error), problem=str(error))
    problem = str(caught[0].message) if caught else ""  # models of another robot mostly come together
    if problem and action_set == DEFAULT_SET:
        warn(f"action set {action_set}: {problem}")
    return ModelSet(models, problem=problem)


class LearnedSets(Generic[User]):
    """The models of a node: those of its parameter `models`, or the set that `learned` has in use.

    Parameters
    ----------
    load : callable
        Makes what the node works with of a folder of models; called in a thread when a set is new, and may
        not touch what the node uses.

    Attributes
    ----------
    present : Loaded
        The models in use, and what uses them.
    """

    def __init__(
        self,
        node: Node,
        domain: Domain,
        models: str,
        learned: str,
        load: Callable[[Path], Loaded[User]],
    ) -> None:
        self._node, self._load = node, load
        self._folder = Path(learned).expanduser() if learned else None
        self._threads = ThreadPoolExecutor(1)
        self._loading: Future[tuple[Manifest, Loaded[User]]] | None = None
        self._seen = None if self._folder is None else current_set(self._folder)
        self._manifest: Manifest | None = None
        self._source = f"models in {models}" if models else "shipped models"
        place = Path(models) if models else domain.shipped_models
        if self._seen is not None:
            try:
                self._manifest = read_manifest(self._seen)
                self._source, place = f"learned set {self._manifest.digest}", self._seen
            except FileError as error:
                self._log_failure(error)
        node.get_logger().info("loading models and code; the first start compiles it for some seconds")
        self.present = load(place)
        if self._folder is not None:
            node.create_timer(_PERIOD, self._look, clock=STEADY)

    def _look(self) -> None:
        """Take over a set that has been loaded, or begin to load a new one."""
        assert self._folder is not None
        if self._loading is not None:
            if self._loading.done():
                self._take_over(self._loading)
                self._loading = None
            return
        place = current_set(self._folder)
        if place is not None and place != self._seen:
            self._seen = place
            self._loading = self._threads.submit(lambda: (read_manifest(place), self._load(place)))

    def _take_over(self, loading: Future[tuple[Manifest, Loaded[User]]]) -> None:
        try:
            self._manifest, loaded = loading.result()
        except Exception as error:  # whatever it is, the node continues with what it has
            self._log_failure(error)
            return
        self.present = loaded
        self._node.get_logger().info(f"switched to the learned set {_described(self._manifest)}")

    def _log_failure(self, error: Exception) -> None:
        name = "" if self._seen is None else self._seen.name
        self._node.get_logger().warning(f"the learned set {name} is not used: {str(error) or repr(error)}")

    def startup_text(self) -> str:
        """Return what a node logs of its models at the start: those of the default action set."""
        read = self.present.models[DEFAULT_SET]
        if not read.models:
            return f"no models ({read.absent})"
        return f"{self._source}: {', '.join(read.models)}"

    @property
    def problem(self) -> str:
        """The problems of all models in one line; empty if there are none."""
        models = self.present.models.items()
        return "; ".join(f"action set {name}: {read.problem}" for name, read in models if read.problem)

    def diagnostics(self) -> dict[str, object]:
        """Return the diagnostics of each action set's models, and of the learned set in use."""
        values: dict[str, object] = {}
        for name, read in self.present.models.items():
            values[f"models of {name}"] = ", ".join(read.models) or read.problem or "no models"
        if self._folder is not None:
            values["learned set"] = "none yet" if self._manifest is None else _described(self._manifest)
        return values


def _described(manifest: Manifest) -> str:
    episodes = ", ".join(f"{count} of {name}" for name, count in sorted(manifest.episodes.items()))
    return f"{manifest.digest} of {manifest.time} from episodes: {episodes or 'none'}"


def load_predictors(node: Node, domain: Domain, libraries: Libraries, place: Path) -> Loaded[Predictor]:
    """Read the models in a folder of every action set; log what is wrong."""
    models, predictors = {}, {}
    for name, library in libraries.items():
        models[name] = read = read_models(node, library.robot, name, place, domain)
        predictors[name] = Predictor(library.robot, read.models)
    return Loaded(models, predictors)


def warmed_up_predictors(
    node: Node, settings: Mapping[str, Any], domain: Domain, libraries: Libraries
) -> LearnedSets[Predictor]:
    """Return the predictors that the parameters `models` and `learned` name, and warm up all actions."""
    load = functools.partial(load_predictors, node, domain, libraries)
    sets = LearnedSets(node, domain, settings["models"], settings["learned"], load)
    for name, library in libraries.items():
        warm_up_actions(library, sets.present.by_set[name])
    return sets


def load_refiners(
    node: Node, domain: Domain, libraries: Libraries, place: Path, *, fence: Fence
) -> Loaded[Refiner]:
    """Read models and gates in a folder of every action set; log what is wrong.

    A set without models has no refiner. Places are searched inside the `fence`.
    """
    models, refiners = {}, {}
    for name, library in libraries.items():
        models[name] = read = read_models(node, library.robot, name, place, domain)
        if read.models:
            refiners[name] = Refiner(
                library.robot,
                read.models,
                _gate(node, models_folder(place, name), name),
                ranges=fence.narrowed(domain.ranges, library.robot),
            )
            warm_up_refinement(library, refiners[name])
    return Loaded(models, refiners)


def _gate(node: Node, folder: Path, action_set: str) -> Gate:
    """Read the gate of an action set; without one the predicted gain alone decides."""
    try:
        return gate_in(folder, action_set)
    except FileError as error:
        node.get_logger().warning(f"no gate, refining whenever a gain is predicted: {error}")
        return OpenGate()
