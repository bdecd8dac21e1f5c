"""Parameters of nodes: type, description and bounds, declared and checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node

from ator_ros.bases.description import ConfigError, Robot
from ator_ros.domains import DEFAULT
from ator_ros.domains.domain import Domain, DomainError, domain_for, find_domain
from ator_ros.execution.fence import Fence
from ator_ros.files import FileError
from ator_ros.printable import ReadableError, printable, quoted
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition
from ator_ros.tops.library import TopLibrary
from ator_ros.world.readers import plain_frame


class SetupError(ReadableError):
    """A node that cannot start with these parameters or files; the message is for the user."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a node, of the type of its default value.

    `low` and `high` bound a number. `choices` are the allowed texts; if "true" is one of them, the
    boolean true means it, and false likewise. Only a `live` parameter can change while the node
    runs.
    """

    name: str
    default: Any
    description: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    live: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Return the descriptor, which `ros2 param describe` shows."""
        descriptor = ParameterDescriptor(description=self.description, read_only=not self.live)
        descriptor.dynamic_typing = "true" in self.choices
        allowed = f"one of {', '.join(self.choices)}" if self.choices else ""
        fixed = "" if self.live else "restart the node to change it"
        descriptor.additional_constraints = "; ".join(filter(None, (allowed, fixed)))
        if isinstance(self.default, bool | str) or not math.isfinite(self.high - self.low):
            return descriptor
        if isinstance(self.default, int):
            low = int(self.low)
            high = int(self.high)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=self.low, to_value=self.high)
            ]
        return descriptor

    def read(self, value: Any) -> Any:
        """Return `value` as the node uses it; raises SetupError if it is none of the choices."""
        if "true" in self.choices and isinstance(value, bool):
            value = str(value).lower()
        if self.choices and value not in self.choices:
            expected = f"expected one of {', '.join(self.choices)}"
            raise SetupError(f"parameter {self.name}: {expected}, got {quoted(value)}")
        return plain_frame(value) if self.name in ("frame", "robot_frame") else value


_OF_ROS = ("use_sim_time", "start_type_description_service")
ROBOT = Parameter("robot", "", "file of the robot's description; empty: the one that is shipped")
DOMAIN = Parameter(
    "domain",
    "",
    "installed domain, or the YAML file of one; empty: soccer with holder and ball, else drive",
)
FRAME = Parameter(
    "frame", "odom", "frame of odometry, objects and goals; an empty frame_id means it"
)
ROBOT_FRAME = Parameter(
    "robot_frame", "base_link", "the robot's own frame, in the middle of its axle"
)
MODELS = Parameter("models", "", "folder of the performance models; empty: the shipped ones")
MAP = Parameter("map", "", "map of the building: a file (.yaml), or a topic; empty: the domain's")
PLANNER = Parameter(
    "planner",
    "",
    "action of type nav2_msgs/ComputePathToPose, whose paths are the routes on the map; "
    "empty: own routes",
)
FRAMES = (FRAME, ROBOT_FRAME)
WORLD = (DOMAIN, ROBOT, MAP)
"""The parameters that `domain_and_robot` reads."""
FENCE = Parameter(
    "fence", [0.0] * 4, "m: x and y from, x and y to, of the robot's axle; all 0: area and margin"
)
STATE = Parameter(
    "robot_from", "odom", "where the robot's state comes from: odom, or tf", choices=("odom", "tf")
)
STAMPED = Parameter(
    "stamped_commands",
    "auto",
    "whether cmd_vel is a TwistStamped; auto: what the base subscribes to",
    choices=("auto", "true", "false"),
)
SHARED = frozenset(
    (
        *(item.name for item in (*FRAMES, *WORLD, STATE, STAMPED, FENCE, MODELS, PLANNER)),
        "learned",
    )
)
"""Names of parameters that several nodes have: one section of a file may set them for all nodes."""
OBJECT = "OBJECT"  # placeholder for the name of an object in ``--help``
live = partial(Parameter, live=True)


def domain_and_robot(settings: Mapping[str, Any]) -> tuple[Domain, Robot]:
    """Return the domain and robot that the parameters of `WORLD` select; raises SetupError."""
    try:
        domain = domain_for(settings[DOMAIN.name], settings[ROBOT.name])
        domain = domain.on_map(map_file(settings))
        return domain, domain.robot(settings[ROBOT.name] or None)
    except (ConfigError, DomainError) as error:
        raise SetupError(str(error)) from error
    except FileError as error:
        raise SetupError(f"parameter map: {error}") from error


def map_file(settings: Mapping[str, Any]) -> str:
    """Return the file that `MAP` names; empty if it names a topic, or nothing."""
    name = settings.get(MAP.name, "")
    return "" if not name or map_topic(settings) else str(Path(name).expanduser())


def map_topic(settings: Mapping[str, Any]) -> str:
    """Return the topic that `MAP` names; empty if it names a file, or nothing."""
    name = str(settings.get(MAP.name, ""))
    return "" if name.endswith((".yaml", ".yml")) else name


def fence_of(settings: Mapping[str, Any], robot: Robot) -> Fence:
    """Return the area that the robot may drive in; raises SetupError."""
    edges = settings[FENCE.name]
    try:
        return Fence.around(robot) if list(edges) == FENCE.default else Fence.of(edges)
    except ValueError as error:
        raise SetupError(f"parameter fence: {error}") from error


def driving_top(library: TopLibrary) -> Top:
    """Return the first TOP that drives the robot to a pose in any situation; raises SetupError."""
    for top in library.values():
        placed = {term.variable for term in top.post.terms if str(term.target).startswith("goal.")}
        if top.pre == Condition() and placed >= {"robot.x", "robot.y", "robot.yaw"}:
            return top
    raise SetupError("parameter domain: expected a TOP that only drives to a pose, found none")


def declare_parameters(
    node: Node, parameters: Sequence[Parameter], *, unused: Collection[str] = ()
) -> dict[str, Any]:
    """Declare parameters with type, description and bounds, and return their values by name.

    The values of live parameters change with them. Unknown parameters, except `unused` and `SHARED`
    ones, are reported if the node was made with
    ``automatically_declare_parameters_from_overrides``. Raises SetupError if a value has another
    type, or is not allowed.
    """
    values = {parameter.name: _declared(node, parameter) for parameter in parameters}
    given = [name for name in node.get_parameters_by_prefix("") if _is_implicit(node, name)]
    unknown = sorted(name for name in given if name not in _OF_ROS)
    for name in unknown:
        node.undeclare_parameter(name)
    if unknown := [name for name in unknown if name not in SHARED.union(unused)]:
        text = f"ignored: parameters {', '.join(map(printable, unknown[:5]))}"
        node.get_logger().warning(f"{text}: expected some of {', '.join(values)}")

    # ROS checks bounds, and that they are live
    def take(changes: Sequence[Any]) -> SetParametersResult:
        values.update({item.name: item.value for item in changes if item.name in values})
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(take)
    return values


def declare_with_domain(
    node: Node, parameters_for: Callable[[Sequence[str]], Sequence[Parameter]]
) -> dict[str, Any]:
    """Declare the parameters that `parameters_for` returns for the domain's objects, with `WORLD`.

    Raises SetupError as `declare_parameters`, and if the domain cannot be used.
    """
    domain, _ = domain_and_robot({item.name: _declared(node, item) for item in (DOMAIN, ROBOT)})
    # The shipped parameter files set those of soccer's objects in every domain.
    unused = {item.name for item in parameters_for(find_domain(DEFAULT).objects)}
    return declare_parameters(node, parameters_for(domain.objects), unused=unused)


def _declared(node: Node, parameter: Parameter) -> Any:
    """Declare a parameter, unless it is declared already, and return its value.

    Raises SetupError.
    """
    name = parameter.name
    try:
        if _is_implicit(node, name):
            node.undeclare_parameter(name)
        if not node.has_parameter(name):
            node.declare_parameter(name, parameter.default, parameter.descriptor())
    except ParameterException as error:
        raise SetupError(f"parameter {name} ({parameter.description}): {error}") from error
    return parameter.read(node.get_parameter(name).value)


def _is_implicit(node: Node, name: str) -> bool:
    """Return whether a parameter exists only because a command line or parameter file sets it."""
    return node.has_parameter(name) and not node.describe_parameter(name).description
