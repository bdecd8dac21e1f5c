"""The interface of actions (paper, section 2.1).

Actions are control programs from estimated state to velocity commands.

One that another program executes returns no commands.
"""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from ator_ros.bases.description import Robot
from ator_ros.geometry import FloatArray, Pose, as_float, decimal_pose
from ator_ros.printable import ReadableError
from ator_ros.world.state import STOP, Command, World


class Status(enum.Enum):
    """The status of an action after a tick."""

    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    REFUSED = "refused"
    """Its action server did not accept the goal: nothing was executed, so nothing is learned."""


class Point(enum.Enum):
    """The point of the robot that arrives at the goal."""

    AXLE = "axle"
    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class Goal:
    """The destination of an action.

    Attributes
    ----------
    pose : Pose
        Destination of `point`, and the robot's heading there (m, rad, world frame).
    speed : float
        Translational velocity at arrival in m/s, not negative.
    point : Point
        AXLE, or HOLD if the position is that of an object in the robot's holder.
    values : mapping of str to float
        The values of the goal variables that the action declares, by name; see `ActionSpec`.
    """

    pose: Pose
    speed: float = 0.0
    point: Point = Point.AXLE
    values: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        """Read whole numbers as floats."""
        object.__setattr__(self, "pose", decimal_pose(self.pose))
        object.__setattr__(self, "speed", as_float(self.speed))

    def robot_pose(self, robot: Robot) -> Pose:
        """Return the pose of the axle at this destination."""
        return robot.pose_holding(self.pose) if self.point is Point.HOLD else self.pose


@dataclass(frozen=True, slots=True)
class Step:
    """One tick of an action, with the reason of its status as a sentence.

    `command` is None if another program moves the robot; then nothing is published.
    """

    command: Command | None
    status: Status
    message: str


class ActionError(ReadableError, ValueError):
    """An action cannot be executed: by this robot, from this state, or to this goal."""


class Action(ABC):
    """A control program: set up, started with a goal, stepped once per control tick, ended once.

    Actions are black boxes: their performance is learned by observation alone. Each goal gets a new
    instance. If the goal of a step changes, the new instance starts before the previous one ends.
    """

    name: ClassVar[str]

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def setup(self) -> None:  # noqa: B027
        """Prepare what all instances need for this robot, such as tables, before the first tick.

        It may be called several times: keep tables in a cache of the module.

        Raises
        ------
        ActionError
            The action cannot be executed by this robot.
        """

    @abstractmethod
    def start(
        self,
        world: World,
        goal: Goal,
    ) -> None:
        """Commit to `goal` from the state `world`.

        Raises
        ------
        ActionError
            The action cannot be executed from here, or the goal is not one of this action's.
        """

    def followed_by(self, goals: Sequence[Goal]) -> None:  # noqa: B027
        """Take the goals to which the robot drives on after passing this one, up to its next stop.

        Called after `start`.

        Raises
        ------
        ActionError
            The action cannot be executed.
        """

    @property
    def drives_on(self) -> bool:
        """Whether the robot drives on to the goals of `followed_by` without a further command."""
        return False

    def take_over(self, former: Action) -> None:  # noqa: B027
        """Continue from an action whose goal is passed, so that the robot need not stop.

        Called after `start`; `former` has the same name, and is ended after that.
        """

    @abstractmethod
    def step(self, world: World) -> Step:
        """Return the command for the next tick; `Step.status` says whether the action has ended."""

    def is_before_result(self, world: World) -> bool:  # noqa: ARG002
        """Return whether `world` may be older than the result that `step` has returned.

        Actions that are executed here end with a state.
        """
        return False

    def path(self) -> FloatArray | None:
        """Return the planned poses of the axle, shape (n, 3): x, y in m, yaw in rad.

        None without a plan. For drawing only; execution does not need it.
        """
        return None

    def end(self, reason: str) -> None:  # noqa: B027
        """Release what `start` has acquired, such as a connection or a goal of an action server.

        Called exactly once after every `start` that did not raise, whatever ended the action;
        `reason` is a sentence.
        """


def finished(
    status: Status,
    message: str,
    command: Command | None = STOP,
) -> Step:
    """Return the last step of an action."""
    return Step(command, status, message)
