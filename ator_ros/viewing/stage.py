"""What a view needs of whatever simulates, refines and executes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

from ator_ros.geometry import FloatArray, Pose
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.guest import Guest
from ator_ros.viewing.history import History
from ator_ros.viewing.runs import Run
from ator_ros.world.state import World


class StageError(RuntimeError):
    """Something that was asked of a stage did not happen; the message says what."""


class AbsentError(StageError):
    """What is needed for it is not running now, but may start."""


class ViewStage(Protocol):
    """Robot, objects, refinement and executor, as a view uses them. All that asks may raise StageError."""

    @property
    def can_place(self) -> bool:
        """Whether robot and objects can be placed, as in a simulation."""

    @property
    def history(self) -> History:
        """The chains that were executed, whoever sent them."""

    @property
    def learned(self) -> str:
        """What is known of the learned set of models in use; empty where nothing is learned."""

    @property
    def silence(self) -> float:
        """Real s since the last state was heard."""

    @property
    def refused(self) -> str:
        """Why robot or objects are not where they were put last; empty where they are."""

    @property
    def guest(self) -> Guest | None:
        """The chain that somebody else sent last, under way or over; None where the last one is ours."""

    def way(self) -> FloatArray | None:
        """Return the planned way of the action under way, shape (n, 2): x and y in m; None without one."""

    def world(self) -> World | None:
        """Return the newest state; None before the first one."""

    def refine(self, draft: Draft, *, as_given: bool = False) -> Advice:
        """Return what refinement says of a draft; raises AbsentError where nobody refines at present.

        By default values of open variables are placeholders; `as_given` the chain is compared with them.
        """

    def place_robot(self, pose: Pose) -> None:
        """Put the robot somewhere, at rest; not waited for."""

    def place_object(self, name: str, x: float, y: float) -> None:
        """Put an object somewhere (m), at rest; not waited for."""

    def place(self, world: World) -> None:
        """Put robot and objects to their places, and take other objects away; wait until they are seen there.

        Time may stand still afterwards, but not where this fails.
        """

    def execute(self, run: Run, draft: Draft, *, refine: bool) -> None:
        """Start to execute the chain of a draft, and resume time even if this fails.

        `run` is told how it goes.
        """

    def watch(self) -> None:
        """End the run under way as lost where nobody executes it any more, that of others, too."""

    def stop(self) -> None:
        """Cancel what is executed, whoever sent it."""

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""

    def set_factor(self, factor: float) -> None:
        """Set the simulated seconds per real second."""


NO_STAGES: Mapping[str, ViewStage] = MappingProxyType({})
