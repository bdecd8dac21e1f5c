"""The state machines of a goal and of each step of its chain, as tables of their transitions."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from types import MappingProxyType

from ator_ros.execution.phases import Ending, Phase


class Signal(enum.Enum):
    """What happens to a goal besides its endings."""

    READY = "all that the chain needs is known, and no refinement is wanted"
    ASKED = "all that the chain needs is known, and refinement is asked"
    ANSWERED = "refinement has answered or timed out"
    STOOD = "the robot stands, or the time to stop is over"
    SILENT = "odometry is missing, so no state will show that the robot stands"
    DROPPED = "the goal does not wait until the robot stands: a newer goal takes over, or the program ends"


Event = Signal | Ending

_FROM_OUTSIDE = (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN, Ending.INPUT_LOST, Ending.BASE_FAULT)
ENDINGS: Mapping[Phase, tuple[Ending, ...]] = MappingProxyType(
    {
        Phase.WAITING: (*_FROM_OUTSIDE, Ending.REFUSED),
        Phase.REFINING: _FROM_OUTSIDE,
        Phase.EXECUTING: (
            *_FROM_OUTSIDE,
            Ending.SUCCEEDED,
            Ending.FAILED,
            Ending.OBJECT_LOST,
            Ending.OUT_OF_BOUNDS,
        ),
    }
)
"""How a goal may end in each phase; the robot then stops."""

TRANSITIONS: Mapping[tuple[Phase, Event], Phase] = MappingProxyType(
    {
        (Phase.WAITING, Signal.READY): Phase.EXECUTING,
        (Phase.WAITING, Signal.ASKED): Phase.REFINING,
        (Phase.REFINING, Signal.ANSWERED): Phase.EXECUTING,
        (Phase.EXECUTING, Signal.ANSWERED): Phase.EXECUTING,
        **{(phase, ending): Phase.STOPPING for phase, endings in ENDINGS.items() for ending in endings},
        (Phase.STOPPING, Ending.BASE_FAULT): Phase.STOPPING,  # instead of a success
        (Phase.STOPPING, Signal.STOOD): Phase.ENDED,
        (Phase.STOPPING, Signal.SILENT): Phase.ENDED,
        (Phase.STOPPING, Signal.DROPPED): Phase.ENDED,
    }
)
"""All transitions: phase and event, and the phase that follows."""


class Stage(enum.Enum):
    """Where one step of a chain is, while its goal is in the phase EXECUTING."""

    STANDING = "waiting until the robot stands"
    READY = "ready to start its action"
    ACTING = "its action runs"
    SETTLING = "its action has ended, its effect is awaited"
    OVER = "over"


STAGES: Mapping[Stage, frozenset[Stage]] = MappingProxyType(
    {
        Stage.STANDING: frozenset({Stage.READY, Stage.OVER}),
        Stage.READY: frozenset({Stage.ACTING, Stage.OVER}),
        Stage.ACTING: frozenset({Stage.SETTLING, Stage.OVER}),
        Stage.SETTLING: frozenset({Stage.OVER}),
        Stage.OVER: frozenset(),
    }
)
"""The stages that may follow each stage; an action is ended when its step leaves ACTING."""


class TransitionError(RuntimeError):
    """An event that the present phase does not know: a fault of the program."""


class GoalCourse:
    """The course of one goal: its phase, and how it ended. Both change by `TRANSITIONS` only."""

    def __init__(self) -> None:
        self._phase = Phase.WAITING
        self._ending: Ending | None = None

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self._phase

    @property
    def ending(self) -> Ending | None:
        """How the goal ended; None before."""
        return self._ending

    def take(self, event: Event) -> None:
        """Go on to the phase that follows.

        Raises
        ------
        TransitionError
            The table has no such transition.
        """
        following = TRANSITIONS.get((self._phase, event))
        if following is None:
            raise TransitionError(f"phase {self._phase.name}: expected another event, got {event.name}")
        self._phase = following
        if isinstance(event, Ending):
            self._ending = event
