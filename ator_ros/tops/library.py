"""The TOP library: TOPs frequently used in the domain, and their actions (paper, section 2.1)."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from ator_ros.actions.base import Action, Goal
from ator_ros.actions.goal_variables import (
    ORDER,
    STOP,
    STOPS,
    GoalVariable,
    goal_values,
    with_values,
)
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import ConfigError, Robot
from ator_ros.geometry import Pose
from ator_ros.printable import quoted
from ator_ros.tops.chain import Top, TopCall
from ator_ros.tops.conditions import state_of
from ator_ros.tops.objects import missing_object
from ator_ros.tops.ranges import USUAL_RANGES, Ranges
from ator_ros.world.state import World


class LeftOutError(ConfigError, KeyError):
    """A requested TOP has no action in the set."""

    __str__ = Exception.__str__  # KeyError would put quotation marks around the message


class TopLibrary(Mapping[str, Top]):
    """TOPs by name, and the actions that execute them.

    TOPs whose action the set lacks are left out: `left_out` has the reasons by the names of these
    TOPs.

    Parameters
    ----------
    actions : mapping
        Factories of the actions by name, each called with the robot.
    goal_variables : mapping, optional
        The goal variables that actions declare beyond pose and speed, by the names of the actions.
    """

    def __init__(
        self,
        robot: Robot,
        action_set: str,
        *,
        tops: Iterable[Top],
        actions: Mapping[str, Callable[[Robot], Action]],
        ranges: Ranges = USUAL_RANGES,
        goal_variables: Mapping[str, tuple[GoalVariable, ...]] = MappingProxyType({}),
    ) -> None:
        self.robot = robot
        self.action_set = action_set
        self.ranges = ranges
        self._actions = dict(actions)
        self._set_up: set[str] = set()
        self._goal_variables = dict(goal_variables)
        self._tops: dict[str, Top] = {}
        self.left_out: dict[str, str] = {}
        for top in tops:
            if top.action in self._actions:
                self._tops[top.name] = top
            else:
                self.left_out[top.name] = (
                    f"{top.name} needs the action {top.action}; "
                    f"action set {action_set} has none of that name"
                )

    def with_robot(self, robot: Robot) -> TopLibrary:
        """Return the same TOPs and actions for a robot of the same type in another scene."""
        library = copy.copy(self)
        library.robot = robot
        library._set_up = set()
        return library

    def __getitem__(self, name: str) -> Top:
        if name in self.left_out:
            raise LeftOutError(self.left_out[name])
        if name not in self._tops:
            raise KeyError(f"TOP: expected one of {sorted(self._tops)}, got {quoted(name)}")
        return self._tops[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tops)

    def __len__(self) -> int:
        return len(self._tops)

    def usable(self) -> list[Top]:
        """Return the TOPs that the robot can execute; some need a holder."""
        return [top for top in self.values() if top.lacks(self.robot) is None]

    def action(self, top: Top) -> Action:
        """Return a new action that executes `top`.

        The first is set up, which may raise ActionError.
        """
        action = self._actions[top.action](self.robot)
        if top.action not in self._set_up:
            action.setup()
            self._set_up.add(top.action)
        return action

    def goal_variables(self, top: Top) -> tuple[GoalVariable, ...]:
        """Return the goal variables that the action of `top` declares beyond pose and speed."""
        return self._goal_variables.get(top.action, ())

    def goal(
        self,
        top: Top,
        pose: Pose,
    ) -> Goal:
        """Return a goal of `top` at rest, with usual values of the variables of its action."""
        values = {variable.name: variable.usual for variable in self.goal_variables(top)}
        return Goal(
            pose,
            0.0,
            top.point,
            values,
        )

    def station(
        self,
        top: Top,
        pose: Pose,
        *,
        keeps_place: bool,
        keeps_heading: bool,
        may_pass: bool = False,
        passes: bool = False,
        may_be_last: bool = True,
    ) -> TopCall:
        """Return the call of `top` that visits a station of a round.

        Parameters
        ----------
        keeps_place, keeps_heading : bool
            Whether its place in the round, and its heading, are not open.
        may_pass : bool
            Whether it is open if the robot stops there, unless the heading is kept.
        passes : bool
            Whether the robot passes it in the round as listed, if that is open.
        may_be_last : bool
            Whether the round may end there. Refinement stops at the end of a chain, but an arrival
            speed that is open would be one there, too.
        """
        goal = self.goal(top, pose)
        opened = set() if keeps_heading else {"yaw"}
        can_stop = STOPS in self.goal_variables(top)
        can_pass = can_stop or ("speed" in self.ranges and not may_be_last)
        if may_pass and can_pass and not keeps_heading:
            opened.add(STOP)
            if passes and can_stop:
                goal = with_values(goal, {STOP: 0.0})
        if not keeps_place:
            opened.add(ORDER)
        return TopCall(top, goal, frozenset(opened))


def top_of(
    situation: Situation,
    tops: Sequence[Top],
    robot: Robot,
) -> Top:
    """Return the TOP of a situation: one with its action and point, and without other objects.

    Of several it is the first with the fewest violations of its pre-condition.

    Raises
    ------
    ConfigError
        There is none.
    """
    world = World(0.0, situation.robot, situation.objects)
    point = situation.goal.point
    objects = sorted(situation.objects)
    suited = [
        top
        for top in tops
        if top.action == situation.action and top.point is point and not missing_object(top, world)
    ]
    if not suited:
        raise ConfigError(
            f"situation of {situation.action}: expected a TOP with this action, a goal for the "
            f"{point.value} and no objects but {objects}, got none of {[top.name for top in tops]}"
        )
    state = state_of(world, robot)
    goal = goal_values(situation.goal)
    return min(suited, key=lambda top: len(top.pre.violations(state, goal)))
