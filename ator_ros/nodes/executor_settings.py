"""Parameters of the node `executor`, and what is made of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ator_ros.actions.remote import LONGEST
from ator_ros.execution.phases import Deadlines
from ator_ros.execution.refining import AGAIN_AFTER
from ator_ros.execution.rolling import Rolling
from ator_ros.nodes.learned_sets import LEARNED
from ator_ros.nodes.parameters import (
    DOMAIN,
    FENCE,
    FRAME,
    MODELS,
    ROBOT,
    ROBOT_FRAME,
    STAMPED,
    STATE,
    Parameter,
    SetupError,
)
from ator_ros.robot.description import Robot
from ator_ros.world.estimation import ObjectTracker, Sightings
from ator_ros.world.inputs import Inputs

_USUAL = Deadlines()
_COMMON = (
    FRAME,
    ROBOT_FRAME,
    STATE,
    STAMPED,
    DOMAIN,
    ROBOT,
    MODELS,
    LEARNED,
    # Timeouts: from one control tick to `LONGEST`, or to a minute where the robot waits amid a chain.
    Parameter("start_timeout", _USUAL.start, "real s that a goal waits for inputs", 0.05, LONGEST, live=True),
    Parameter(
        "odom_timeout",
        _USUAL.odom,
        "real s without odometry, more if its stamps are slower than real time; the robot pauses after half",
        0.05,
        60.0,
        live=True,
    ),
    # A base that does not follow is stopped within 0.5 s: with more latency nothing can be known by then.
    Parameter("latency", 0.0, "s from a state's stamp until its answer moves the base", 0.0, 0.3, live=True),
    FENCE,
    Parameter("plan_timeout", 10.0, "real s that a goal waits for its chains", 0.05, LONGEST, live=True),
    Parameter(
        "refinement_timeout", _USUAL.refinement, "real s that refinement may take", 0.01, 60.0, live=True
    ),
    Parameter(
        "refine_again_after", AGAIN_AFTER, "m off what was expected to ask again, or 0", 0.0, 10.0, live=True
    ),
    Parameter(
        "action_timeout", _USUAL.action, "s, by the stamps, that one action may take", 1.0, LONGEST, live=True
    ),
)


def parameters_for(objects: Sequence[str]) -> tuple[Parameter, ...]:
    """Return the parameters of the node, among them three for each of the `objects`."""
    return (*_COMMON, *(parameter for name in objects for parameter in _parameters_of(name)))


def _parameters_of(name: str) -> tuple[Parameter, ...]:
    return (
        Parameter(
            f"{name}_timeout",
            0.3,
            f"s by which the {name} may be older than odometry; the robot pauses after half",
            0.05,
            60.0,
            live=True,
        ),
        # A tracker that errs by more than 1 m or 10 m/s says nothing about an object of a robot's size.
        Parameter(
            f"{name}_noise", 0.0, f"m, standard deviation of the {name}'s coordinates; 0: exact", 0.0, 1.0
        ),
        Parameter(f"{name}_velocity_noise", 0.0, "m/s, standard deviation of its velocity", 0.0, 10.0),
    )


def inputs_of(settings: Mapping[str, Any], objects: Iterable[str]) -> Inputs:
    """Return what joins odometry and the objects; raises SetupError."""
    return Inputs({name: _sightings(settings, name) for name in objects})


def _sightings(settings: Mapping[str, Any], name: str) -> Sightings:
    noise, velocity_noise = settings[f"{name}_noise"], settings[f"{name}_velocity_noise"]
    if (noise > 0.0) != (velocity_noise > 0.0):
        raise SetupError(
            f"parameters {name}_noise and {name}_velocity_noise: expected both above 0 or both 0, "
            f"got {noise:g} and {velocity_noise:g}"
        )
    return Sightings(name, settings[f"{name}_timeout"], ObjectTracker(noise, velocity_noise))


def rolling_of(settings: Mapping[str, Any], robot: Robot) -> Rolling:
    """Return what watches objects roll, at speeds that stand out from the noise."""
    noises = (value for name, value in settings.items() if name.endswith("_velocity_noise"))
    return Rolling(robot, slowest=3.0 * max(noises, default=0.0))


def deadlines_of(settings: Mapping[str, Any]) -> Deadlines:
    """Return when to give up waiting."""
    names = (field.name for field in dataclasses.fields(Deadlines))
    return Deadlines(**{name: settings[f"{name}_timeout"] for name in names})
