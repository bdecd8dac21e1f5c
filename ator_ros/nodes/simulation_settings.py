"""Parameters of the node `simulation`, and what is made of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ator_ros.files import is_name
from ator_ros.geometry import Pose
from ator_ros.nodes.parameters import DOMAIN, FRAME, ROBOT, ROBOT_FRAME, Parameter, SetupError, robot_of
from ator_ros.nodes.simulated_world import SimulatedRobot, SimulatedWorld
from ator_ros.printable import quoted
from ator_ros.robot.description import Robot
from ator_ros.simulation.sensors import SensorConfig, Sensors, Sight
from ator_ros.world import messages
from ator_ros.world.messages import MessageError
from ator_ros.world.scene import Area

_COMMON = (
    FRAME,
    ROBOT_FRAME,
    DOMAIN,
    ROBOT,
    # Times as fast as computers can be (0: no limit), and not so slow that a tick takes more than a minute.
    Parameter("robots", [""], "names of the robots, namespaces of their topics and frames; '': none"),
    Parameter("descriptions", [""], "files of robots' descriptions; missing or empty: what `robot` names"),
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
        "command_wait",
        0.2,
        "real s that a tick waits for a command; less than the executor's odom_timeout",
        0.0,
        10.0,
        live=True,
    ),
    Parameter("lockstep", False, "whether ticks wait for commands at any real_time_factor"),
    Parameter("publish_clock", False, "whether to publish the simulated time on /clock"),
    Parameter("stamped_commands", False, "whether the robots subscribe to TwistStamped instead of Twist"),
    Parameter(
        "robot_start",
        [-2.0, 0.0, 0.0],
        "x, y (m, from the area's centre), yaw of each robot after a reset; else beside the last",
    ),
    # Drifts of 1 are errors as large as the motion; the executor allows as much latency.
    Parameter("seed", 0, "of the sensors' noise", 0, 2**31 - 1),
    Parameter("drift", 0.0, "odometry's position error in m after 1 m of driving", 0.0, 1.0),
    Parameter("heading_drift", 0.0, "odometry's heading error in rad after 1 m of driving", 0.0, 1.0),
    Parameter("latency", 0.0, "simulated s after which odom and objects come, with their stamps", 0.0, 0.3),
)
_ASIDE = 1.0
"""m between objects, and between robots, that are where they start by default."""
_MOST_YAW = 1e6
"""rad; far more than turns that a start is given in, and a float64 still resolves 1e-10."""
_MOST = 16
"""Robots of one simulation."""


def parameters_for(objects: Sequence[str]) -> tuple[Parameter, ...]:
    """Return the parameters of the node, among them five for each of the `objects`."""
    return (*_COMMON, *(item for place, name in enumerate(objects) for item in _parameters_of(name, place)))


def _parameters_of(name: str, place: int) -> tuple[Parameter, ...]:
    start = [0.0, _ASIDE * place]
    # Noise of 1 m or 1 m/s, an age of 5 s and one sight in a hundred are beyond what any chain can bear.
    return (
        Parameter(
            f"{name}_start", start, f"position of the {name} after a reset: x, y in m from the area's centre"
        ),
        Parameter(f"{name}_noise", 0.0, f"error of the {name}'s coordinates in m", 0.0, 1.0),
        Parameter(f"{name}_velocity_noise", 0.0, f"error of the {name}'s velocity in m/s", 0.0, 1.0),
        Parameter(f"{name}_delay", 0.0, f"age of what is known of the {name} in simulated s", 0.0, 5.0),
        Parameter(f"{name}_dropouts", 0.0, f"probability that the {name} is not seen in a tick", 0.0, 0.99),
    )


def names_of(settings: Mapping[str, Any]) -> list[str]:
    """Return the names of the robots; raises SetupError where they cannot be told apart by them."""
    names = list(settings["robots"])
    good = 0 < len(names) <= _MOST and len(set(names)) == len(names)
    if not good or not all(is_name(name) for name in names if name or len(names) > 1):
        raise SetupError(
            f"parameter robots: expected 1 to {_MOST} different names of letters, digits and _, "
            f"got {quoted(names)}"
        )
    return names


def robots_of(settings: Mapping[str, Any]) -> list[Robot]:
    """Return the robots, all in the scene of the first; raises SetupError where a file cannot be used."""
    files, names = settings["descriptions"], names_of(settings)
    if len(files) > len(names):
        raise SetupError(f"parameter descriptions: expected at most {len(names)} files, got {len(files)}")
    named = [file or settings[ROBOT.name] for file in (*files, *[""] * (len(names) - len(files)))]
    robots = [robot_of({**settings, ROBOT.name: file}) for file in named]
    return [dataclasses.replace(robot, scene=robots[0].scene) for robot in robots]


def world_of(settings: Mapping[str, Any], robots: Sequence[SimulatedRobot]) -> SimulatedWorld:
    """Return the world at its start.

    Raises
    ------
    SetupError
        A start is outside the floor, or two are one.
    """
    try:
        return SimulatedWorld(robots, _object_starts(settings, robots[0].robot))
    except ValueError as error:
        raise SetupError(str(error)) from error


def _object_starts(settings: Mapping[str, Any], robot: Robot) -> dict[str, tuple[float, float]]:
    places = {name: settings[f"{name}_start"] for name in robot.scene.objects}
    for name, place in places.items():
        messages.count(place, f"parameter {name}_start", least=2, most=2)
    centred = {name: robot.scene.area.at(*place) for name, place in places.items()}
    return {name: (there.x, there.y) for name, there in centred.items()}


def simulated_of(settings: Mapping[str, Any], robots: Sequence[Robot]) -> list[SimulatedRobot]:
    """Return the robots at their starts; what they observe errs independently. Raises SetupError."""
    config = SensorConfig(
        drift=settings["drift"],
        heading_drift=settings["heading_drift"],
        latency=settings["latency"],
        objects={name: _sight_of(settings, name) for name in robots[0].scene.objects},
    )
    try:
        starts = _starts(settings["robot_start"], len(robots), robots[0].scene.area)
    except MessageError as error:
        raise SetupError(str(error)) from error
    named = zip(names_of(settings), robots, starts, strict=True)
    return [
        SimulatedRobot(name, robot, Sensors(config, settings["seed"] + number), start)
        for number, (name, robot, start) in enumerate(named)
    ]


def _starts(numbers: Sequence[float], count: int, area: Area) -> list[Pose]:
    """Return the start of each robot: those given, then each `_ASIDE` to the left of the last."""
    messages.count(numbers, "parameter robot_start", least=3, most=3 * count)
    if len(numbers) % 3:
        raise SetupError(f"parameter robot_start: expected x, y and yaw of each, got {len(numbers)} numbers")
    for yaw in numbers[2::3]:
        messages.number(yaw, "parameter robot_start: yaw", low=-_MOST_YAW, high=_MOST_YAW, unit="rad")
    starts = [area.at(*numbers[at : at + 3]) for at in range(0, len(numbers), 3)]
    while len(starts) < count:
        starts.append(starts[-1].compose(Pose(0.0, _ASIDE, 0.0)))
    return starts


def _sight_of(settings: Mapping[str, Any], name: str) -> Sight:
    kinds = (field.name for field in dataclasses.fields(Sight))
    return Sight(**{kind: settings[f"{name}_{kind}"] for kind in kinds})
