"""Parameters of the node `simulation`, and the world that is made of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ator_ros.geometry import Pose
from ator_ros.nodes import checks
from ator_ros.nodes.parameters import DOMAIN, ROBOT, Parameter, SetupError
from ator_ros.nodes.simulated_world import SimulatedWorld
from ator_ros.robot.description import Robot
from ator_ros.simulation.sensors import SensorConfig, Sensors, Sight

_COMMON = (
    Parameter("frame", "odom", "frame of poses and of the objects"),
    Parameter("robot_frame", "base_link", "frame of the robot, in the middle of its axle"),
    DOMAIN,
    ROBOT,
    Parameter(
        "real_time_factor",
        1.0,
        "simulated per real seconds; 0: as fast as possible",
        0.0,
        100.0,
        smallest=0.001,
        live=True,
    ),
    Parameter(
        "command_wait", 0.3, "real s that a tick waits for a command, where it waits", 0.0, 10.0, live=True
    ),
    Parameter("lockstep", False, "whether ticks wait for commands at any real_time_factor"),
    Parameter("publish_clock", False, "whether to publish the simulated time on /clock"),
    Parameter("stamped_commands", False, "whether cmd_vel is a TwistStamped"),
    Parameter("robot_start", [-2.0, 0.0, 0.0], "pose of the robot after a reset: x, y in m, yaw in rad"),
    Parameter("seed", 0, "of the sensors' noise", 0, 2**31 - 1),
    Parameter("drift", 0.0, "odometry's position error in m after 1 m of driving", 0.0, 1.0),
    Parameter("heading_drift", 0.0, "odometry's heading error in rad after 1 m of driving", 0.0, 1.0),
    Parameter("latency", 0.0, "simulated s after which odom and objects come, with their stamps", 0.0, 0.3),
)
_ASIDE = 1.0
"""m between objects that are where they start by default."""


def parameters_for(objects: Sequence[str]) -> tuple[Parameter, ...]:
    """Return the parameters of the node, among them five for each of the `objects`."""
    return (*_COMMON, *(item for place, name in enumerate(objects) for item in _parameters_of(name, place)))


def _parameters_of(name: str, place: int) -> tuple[Parameter, ...]:
    start = [0.0, _ASIDE * place]
    return (
        Parameter(f"{name}_start", start, f"position of the {name} after a reset: x, y in m"),
        Parameter(f"{name}_noise", 0.0, f"error of the {name}'s coordinates in m", 0.0, 1.0),
        Parameter(f"{name}_velocity_noise", 0.0, f"error of the {name}'s velocity in m/s", 0.0, 1.0),
        Parameter(f"{name}_delay", 0.0, f"age of what is known of the {name} in simulated s", 0.0, 5.0),
        Parameter(f"{name}_dropouts", 0.0, f"probability that the {name} is not seen in a tick", 0.0, 0.99),
    )


def world_of(settings: Mapping[str, Any], robot: Robot) -> SimulatedWorld:
    """Return the world at its start.

    Raises
    ------
    SetupError
        A start is outside the floor.
    """
    try:
        return _world_of(settings, robot)
    except ValueError as error:
        raise SetupError(str(error)) from error


def _world_of(settings: Mapping[str, Any], robot: Robot) -> SimulatedWorld:
    start, objects = settings["robot_start"], robot.scene.objects
    checks.count(start, "parameter robot_start", least=3, most=3)
    places = {name: settings[f"{name}_start"] for name in objects}
    for name, place in places.items():
        checks.count(place, f"parameter {name}_start", least=2, most=2)
    yaw = checks.position(start[2], "parameter robot_start: yaw")
    config = SensorConfig(
        drift=settings["drift"],
        heading_drift=settings["heading_drift"],
        latency=settings["latency"],
        objects={name: _sight_of(settings, name) for name in objects},
    )
    return SimulatedWorld(
        robot,
        Sensors(config, settings["seed"]),
        robot_start=Pose(start[0], start[1], yaw),
        object_starts={name: (place[0], place[1]) for name, place in places.items()},
    )


def _sight_of(settings: Mapping[str, Any], name: str) -> Sight:
    kinds = (field.name for field in dataclasses.fields(Sight))
    return Sight(**{kind: settings[f"{name}_{kind}"] for kind in kinds})
