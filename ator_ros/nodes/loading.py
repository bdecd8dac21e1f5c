"""Load refiners and predictors for every action set."""

from __future__ import annotations

import contextlib
import functools
import os
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.rehearsal import rehearse, rehearse_predictions, rehearse_refinement
from ator_ros.nodes.learned_sets import LearnedSets
from ator_ros.nodes.model_sets import ModelSet, read_models
from ator_ros.performance.model_file import model_path
from ator_ros.refinement import RefinementError
from ator_ros.refinement.gate import Gate, OpenGate, load_gate, opened
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.library import TopLibrary

Libraries = Mapping[str, TopLibrary]


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


_LONG = 3.0  # real s; with compiled code on disk a rehearsal takes less


@contextlib.contextmanager
def _said_if_long(node: Node) -> Iterator[None]:
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
        rehearse_predictions(libraries[name], predictor)
    return Predictors(models, predictors)


def rehearsed_predictors(
    node: Node, settings: Mapping[str, Any], domain: Domain, libraries: Libraries
) -> LearnedSets[Predictors]:
    """Return the predictors that the parameters `models` and `learned` name; all actions are rehearsed."""
    load = functools.partial(load_predictors, node, domain, libraries)
    with _said_if_long(node):
        sets = LearnedSets(node, settings["models"], settings["learned"], load)
        for name, library in libraries.items():
            rehearse(library.robot, library, sets.present.by_set[name])
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

    Places are searched inside the `fence`. A failure costs `failure_cost` (s) where a request does not say.
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
            with _said_if_long(node):
                rehearse_refinement(library, refiners[name])
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
