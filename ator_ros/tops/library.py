"""The TOP library: the TOPs frequently used in the domain, and their actions (paper, section 2.1)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from ator_ros.actions.base import Action
from ator_ros.actions.catalogue import ACTION_SETS
from ator_ros.robot.description import Robot
from ator_ros.tops.top import TOPS, Top


class TopLibrary(Mapping[str, Top]):
    """TOPs by name, and the actions that execute them.

    Parameters
    ----------
    robot : Robot
        The robot that executes.
    action_set : str
        Which set of actions: "default", or the paper's "bezier".
    tops : iterable of Top, optional
        The TOPs on offer; by default goToPose, goToBall, dribbleBall and shoot.
    actions : mapping, optional
        Further action classes by name, for TOPs from outside.

    Raises
    ------
    KeyError
        The action set is unknown, or a TOP names an action that the set lacks.
    """

    def __init__(
        self,
        robot: Robot,
        action_set: str = "default",
        *,
        tops: Iterable[Top] = TOPS,
        actions: Mapping[str, type[Action]] | None = None,
    ) -> None:
        if action_set not in ACTION_SETS:
            raise KeyError(f"action set: expected one of {sorted(ACTION_SETS)}, got {action_set!r}")
        self.robot = robot
        self.action_set = action_set
        self._actions = {**ACTION_SETS[action_set], **(actions or {})}
        self._tops = {top.name: top for top in tops}
        missing = sorted({top.action for top in self._tops.values()} - set(self._actions))
        if missing:
            raise KeyError(
                f"action set {action_set!r}: expected the actions {missing}, it has {sorted(self._actions)}"
            )

    def __getitem__(self, name: str) -> Top:
        try:
            return self._tops[name]
        except KeyError:
            raise KeyError(f"TOP: expected one of {sorted(self._tops)}, got {name!r}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._tops)

    def __len__(self) -> int:
        return len(self._tops)

    def action(self, top: Top) -> Action:
        """Make a new action that executes `top`."""
        return self._actions[top.action](self.robot)
