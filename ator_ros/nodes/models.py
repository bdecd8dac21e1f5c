"""The models of each action set: read at the start, replaced by learned sets, for refiners and predictors."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from rclpy.node import Node

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.warm_up import warm_up_actions, warm_up_predictions, warm_up_refinement
from ator_ros.learning.sets import LearnedSetError, Manifest, current_set, read_manifest
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.parameters import Parameter
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import (
    ModelFileError,
    NoModelsError,
    RobotMismatchWarning,
    load_models,
    model_path,
    models_folder,
)
from ator_ros.refinement import RefinementError
from ator_ros.refinement.calibration import CALIBRATION, Calibration, load_calibration_if_any
from ator_ros.refinement.gate import Gate, OpenGate, load_gate, opened
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary

LEARNED = Parameter(
    "learned",
    "",
    "folder of the node `learning`: its set in use replaces `models` once there is one; empty: none",
)
_PERIOD = 0.5
_SWITCHES = 0.0005
"""Interval in real s at which Python switches threads while a set is loaded; the default is 5 ms."""

Loaded = TypeVar("Loaded")
Libraries = Mapping[str, TopLibrary]


@dataclass(frozen=True, slots=True)
class ModelSet:
    """The performance models of one action set.

    Attributes
    ----------
    folder : Path
        Folder of the files.
    models : mapping
        Action name to model; empty where there are none.
    lacking : tuple of str
        Actions that could be executed and have no model.
    absent : str
        Why there are no models; empty where there are some.
    problem : str
        What is wrong with the models: a damaged file, another robot. It is no problem to have none.
    digest : str
        Digest of the files.
    calibration : Calibration
        Corrections of the predictions; empty where none were learned for these models.
    """

    folder: Path = Path()
    models: Mapping[str, PerformanceModel] = field(default_factory=dict)
    lacking: tuple[str, ...] = ()
    absent: str = ""
    problem: str = ""
    digest: str = ""
    calibration: Calibration = field(default_factory=Calibration)


def read_models(node: Node, robot: Robot, action_set: str, folder: str, domain: Domain) -> ModelSet:
    """Read the models of an action set; log what is wrong.

    Of sets beside the default one, which are seldom used, only damaged files are logged.

    Parameters
    ----------
    node : Node
        The node that logs.
    robot : Robot
        The robot that executes the actions.
    action_set : str
        Name of the set.
    folder : str
        Folder of the models of all sets; empty: the models that ship with the domain.
    domain : Domain
        The domain of the actions.
    """
    log, usual = node.get_logger(), action_set == DEFAULT_SET
    try:
        place = Path(folder) if folder else domain.shipped_models
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RobotMismatchWarning)
            models = load_models(robot, domain.known_features, action_set=action_set, folder=place)
        digest = _digest(place, action_set, models)
    except NoModelsError as error:
        return ModelSet(absent=str(error))
    except (ModelFileError, OSError) as error:  # a missing resource is one
        log.warning(f"action set {action_set}: no models: {error}")
        return ModelSet(absent=str(error), problem=str(error))
    problem = _summary([str(warning.message) for warning in caught])
    if problem and usual:
        log.warning(f"action set {action_set}: {problem}")
    files = models_folder(place, action_set)
    usable = {top.action for top in domain.library(robot, action_set).usable()}
    lacking = tuple(sorted(usable - models.keys()))
    calibration = _calibration(node, files, action_set, models)
    return ModelSet(place, models, lacking=lacking, problem=problem, digest=digest, calibration=calibration)


def _summary(warnings: Sequence[str]) -> str:
    """Return the first warning, and how many more: models of another robot mostly come together."""
    more = f" (and {len(warnings) - 1} more models of this set)" if len(warnings) > 1 else ""
    return warnings[0] + more if warnings else ""


def _calibration(
    node: Node, folder: Path, action_set: str, models: Mapping[str, PerformanceModel]
) -> Calibration:
    """Read the calibration of models; without a usable one, log why and correct nothing."""
    try:
        read = load_calibration_if_any(folder)
    except (RefinementError, OSError) as error:
        node.get_logger().warning(f"action set {action_set}: predictions are not corrected: {error}")
        return Calibration()
    matching = read.matching(models)
    if action_set == DEFAULT_SET and (
        others := sorted(models.keys() & read.shortfalls.keys() - matching.shortfalls.keys())
    ):
        node.get_logger().warning(
            f"action set {action_set}: predictions of {', '.join(others)} are not corrected: "
            f"{folder / CALIBRATION} is of other models; run `calibrate_predictions` to learn it again"
        )
    return matching


def _digest(folder: Path, action_set: str, models: Mapping[str, PerformanceModel]) -> str:
    """Return a short digest of the files of models."""
    files = sorted(folder / model_path(name, action_set) for name in models)
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def startup_text(sets: Mapping[str, ModelSet], source: str) -> str:
    """Return what a node logs of its models at the start: those of the default action set.

    Parameters
    ----------
    sets : mapping of str to ModelSet
        The models of each action set.
    source : str
        Where they come from.
    """
    read = sets[DEFAULT_SET]
    if not read.models:
        return f"no models ({read.absent})"
    none = f", none of {', '.join(read.lacking)}" if read.lacking else ""
    return f"{source}: {', '.join(read.models)}{none}"


def model_diagnostics(sets: Mapping[str, ModelSet]) -> dict[str, object]:
    """Return the diagnostics of each action set's models."""
    models: dict[str, object] = {
        f"models of {name}": ", ".join(read.models) or read.problem or "no models"
        for name, read in sets.items()
    }
    return models | {f"models digest of {name}": read.digest for name, read in sets.items() if read.digest}


def problems_of(sets: Mapping[str, ModelSet]) -> str:
    """Return the problems of all models in one line; empty if there are none."""
    return "; ".join(f"action set {name}: {read.problem}" for name, read in sets.items() if read.problem)


class LearnedSets(Generic[Loaded]):
    """The models of a node: those of its parameter `models`, or the set that `learned` has in use.

    Parameters
    ----------
    node : Node
        Its timers look for new sets.
    models, learned : str
        The parameters.
    load : callable
        Makes what the node works with of a folder of models ("" for those that ship); called in a thread when
        a set is new, and may not touch what the node uses.
    taken : callable, optional
        Called with a set that was loaded in a thread, before it is used: parameters may have changed since.
    """

    def __init__(
        self,
        node: Node,
        models: str,
        learned: str,
        load: Callable[[str], Loaded],
        taken: Callable[[Loaded], None] = lambda _: None,
    ) -> None:
        self._node, self._load, self._taken = node, load, taken
        self._folder = Path(learned).expanduser() if learned else None
        self._thread: threading.Thread | None = None
        self._ready: tuple[Path, Manifest, Loaded] | None = None
        self._failed: tuple[Path, str] | None = None
        self._seen: Path | None = None
        self._manifest: Manifest | None = None
        self._switches = 0
        self.present: Loaded
        self.source: str
        """Where the first models come from, for the log."""
        self._first(models)
        if self._folder is not None:
            node.create_timer(_PERIOD, self._look, clock=STEADY)

    def _first(self, models: str) -> None:
        place = current_set(self._folder) if self._folder is not None else None
        if place is not None:
            self._seen = place
            try:
                self._manifest = read_manifest(place)
                self.present = self._load(str(place))
            except LearnedSetError as error:
                self._log_failure(place, str(error))
            else:
                self.source = f"learned set {self._manifest.digest}"
                return
        self._manifest = None
        self.source = f"models in {models}" if models else "shipped models"
        self.present = self._load(models)

    def _look(self) -> None:
        """Take over a set that has been loaded, or begin to load a new one."""
        if self._thread is not None:
            if not self._thread.is_alive():
                self._thread = None
                self._take_over()
            return
        assert self._folder is not None
        place = current_set(self._folder)
        if place is not None and place != self._seen:
            self._seen = place
            self._thread = threading.Thread(target=functools.partial(self._load_beside, place), daemon=True)
            self._thread.start()

    def _load_beside(self, place: Path) -> None:
        usual = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCHES)
        try:
            manifest = read_manifest(place)
            self._ready = place, manifest, self._load(str(place))
        except Exception as error:  # whatever it is, the node continues with what it has
            self._failed = place, str(error) or repr(error)
        finally:
            sys.setswitchinterval(usual)

    def _take_over(self) -> None:
        if self._failed is not None:
            (place, why), self._failed = self._failed, None
            self._log_failure(place, why)
        if self._ready is not None:
            (_, self._manifest, loaded), self._ready = self._ready, None
            self._taken(loaded)
            self.present = loaded
            self._switches += 1
            self._node.get_logger().info(f"switched to the learned set {_described(self._manifest)}")

    def _log_failure(self, place: Path, why: str) -> None:
        self._node.get_logger().warning(f"the learned set {place.name} is not used: {why}")

    def diagnostics(self) -> dict[str, object]:
        """Return the diagnostics of the set in use."""
        if self._folder is None:
            return {}
        return {
            "learned set": "none yet" if self._manifest is None else _described(self._manifest),
            "switches of the learned set": self._switches,
        }


def _described(manifest: Manifest) -> str:
    episodes = ", ".join(f"{count} of {name}" for name, count in sorted(manifest.episodes.items()))
    return f"{manifest.digest} of {manifest.time} from episodes: {episodes or 'none'}"


@dataclass(frozen=True)
class Predictors:
    """Models and predictors of one folder, by action set."""

    models: Mapping[str, ModelSet]
    by_set: Mapping[str, Predictor]


@dataclass(frozen=True)
class Refiners:
    """Models and refiners of one folder, by action set; a set without models has no refiner."""

    models: Mapping[str, ModelSet]
    by_set: Mapping[str, Refiner]

    def gate_text(self, *, gated: bool) -> str:
        """Return what a node logs at the start of the gate of the default action set, if it has models."""
        if DEFAULT_SET not in self.by_set:
            return "chains stay as they are sent"
        if not gated:
            return "gate is false: a chain is changed whenever a gain is predicted"
        if isinstance(self.by_set[DEFAULT_SET].gate, OpenGate):
            return "no gate: a chain is changed whenever a gain is predicted; train or gate learns one"
        return "with a gate"


_LONG = 3.0  # real s; with compiled code on disk the warm-up takes less


@contextlib.contextmanager
def _log_if_long(node: Node) -> Iterator[None]:
    """Log that code is being compiled if the block takes long, as at the first start of a node."""
    text = "compiling code, as at each first start; later ones use what is kept on disk"
    timer = threading.Timer(_LONG, node.get_logger().info, [text])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def load_predictors(node: Node, domain: Domain, libraries: Libraries, folder: str) -> Predictors:
    """Read the models in `folder` ("": those that ship) of every action set; log what is wrong."""
    models = {name: read_models(node, it.robot, name, folder, domain) for name, it in libraries.items()}
    predictors = {
        name: Predictor(libraries[name].robot, read.models, read.calibration) for name, read in models.items()
    }
    for name, predictor in predictors.items():
        warm_up_predictions(libraries[name], predictor)
    return Predictors(models, predictors)


def warmed_up_predictors(
    node: Node, settings: Mapping[str, Any], domain: Domain, libraries: Libraries
) -> LearnedSets[Predictors]:
    """Return the predictors that the parameters `models` and `learned` name, and warm up all actions."""
    load = functools.partial(load_predictors, node, domain, libraries)
    with _log_if_long(node):
        sets = LearnedSets(node, settings["models"], settings["learned"], load)
        for name, library in libraries.items():
            warm_up_actions(library, sets.present.by_set[name])
    return sets


def load_refiners(
    node: Node,
    domain: Domain,
    libraries: Libraries,
    folder: str,
    *,
    fence: Fence,
    gated: bool,
    failure_cost: float,
) -> Refiners:
    """Read models and gate in `folder` ("": those that ship) of every action set; log what is wrong.

    Places are searched inside the `fence`. `failure_cost` (s) applies to requests without one.
    """
    models, refiners = {}, {}
    for name, library in libraries.items():
        models[name] = read = read_models(node, library.robot, name, folder, domain)
        if read.models:
            gate = _gate(node, read, name, gated=gated)
            refiners[name] = Refiner(
                library.robot,
                read.models,
                gate,
                ranges=fence.narrowed(domain.ranges, library.robot),
                calibration=read.calibration,
                failure_cost=failure_cost,
            )
            with _log_if_long(node):
                warm_up_refinement(library, refiners[name])
    return Refiners(models, refiners)


def set_gates(node: Node, refiners: Refiners, *, gated: bool) -> None:
    """Let the gates decide from the next request on, or no longer."""
    for name, refiner in refiners.by_set.items():
        refiner.gate = _gate(node, refiners.models[name], name, gated=gated)


def _gate(node: Node, read: ModelSet, action_set: str, *, gated: bool) -> Gate:
    """Read the gate of an action set; without one, or not `gated`, the predicted gain alone decides."""
    path = read.folder / model_path("gate", action_set)
    if not os.path.lexists(path):
        return OpenGate()
    try:
        gate = load_gate(path, action_set)
    except RefinementError as error:
        node.get_logger().warning(f"no gate, refining whenever a gain is predicted: {error}")
        return OpenGate()
    return gate if gated else opened(gate)
