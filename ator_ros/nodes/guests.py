"""The chains of others that an executor executes, as a view hears of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from action_msgs.srv import CancelGoal

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.nodes.messages import action_set_from, chain_from, world_from
from ator_ros.nodes.qos import LATCHED, SERVICES
from ator_ros.nodes.silence import Silence, lose
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.printable import printable
from ator_ros.tops.library import TopLibrary
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.guest import OTHERS, Guest
from ator_ros.viewing.runs import Run
from ator_ros.world.messages import MessageError

_TOPIC = "chain_under_way"
_LONGEST = 300


class Guests:
    """Listens to `chain_under_way`.

    Parameters
    ----------
    own : SpunNode
        Not started yet.
    libraries : mapping of str to TopLibrary
        By action set.
    frame : str
        Of all poses.
    is_ours : callable
        Returns whether a chain of this identifier was sent by this view.

    Attributes
    ----------
    present : Guest or None
        The chain that somebody else sent last; None where the last one is ours, or cannot be read.
    """

    def __init__(
        self,
        own: SpunNode,
        libraries: Mapping[str, TopLibrary],
        *,
        frame: str,
        is_ours: Callable[[str], bool],
    ) -> None:
        self._own, self._libraries, self._frame, self._is_ours = own, libraries, frame, is_ours
        self.present: Guest | None = None
        self._silence = Silence()
        self._cancel = own.node.create_client(
            CancelGoal, "execute_chain/_action/cancel_goal", qos_profile=SERVICES
        )
        self._heard = own.node.create_subscription(ChainPerformance, _TOPIC, self._take, LATCHED)

    def _take(self, message: ChainPerformance) -> None:
        former = self.present
        self._silence.broken()
        if self._is_ours(message.chain_id):
            self.present = None
            return
        known = former is not None and former.key == message.chain_id
        run = former.run if former is not None and known else Run(OTHERS)
        try:
            self.present = _guest_from(message, run, self._libraries, self._frame)
        except MessageError as error:
            self.present = None
            self._own.node.get_logger().warning(f"{_TOPIC}: ignored: {error}", throttle_duration_sec=2.0)
        _tell(run, message)

    def watch(self, stamp: float) -> None:
        """Count the chain as lost where its executor is gone, or silent.

        Parameters
        ----------
        stamp : float
            Time in s of the robot's newest state; while it stands nobody has anything to tell.
        """
        guest = self.present
        if guest is None or guest.run.ended:
            return
        there = self._own.node.count_publishers(self._heard.topic_name) > 0
        if self._silence.is_too_long(stamp, there=there):
            lose(guest.run)

    def cancel(self) -> None:
        """Cancel the chain of others that is under way; wait until it has ended.

        Raises
        ------
        StageError
            Nobody answers in time.
        """
        guest = self.present
        if guest is None or guest.run.ended:
            return
        request = CancelGoal.Request()
        request.goal_info.goal_id.uuid = list(bytes.fromhex(guest.key))
        self._own.call(self._cancel, request)
        self._own.until(lambda: guest.run.ended, "the end of the chain of others")


def _guest_from(
    message: ChainPerformance, run: Run, libraries: Mapping[str, TopLibrary], frame: str
) -> Guest:
    """Read what is told of a chain; raises MessageError."""
    if not _is_identifier(message.chain_id):
        raise MessageError("chain_id: expected 32 hexadecimal digits")
    action_set = action_set_from(message.chain, allowed=libraries)
    chain = chain_from(message.chain, libraries[action_set], frame=frame)
    begun = math.isfinite(message.actual.duration)
    return Guest(
        message.chain_id,
        Draft(world_from(message.start, frame=frame, where="start"), chain, action_set),
        run,
        begun=begun,
        refined=message.refined,
        changes=message.refined_again,
        reason=printable(message.refinement if begun else message.outcome.reason, _LONGEST),
    )


def _is_identifier(text: str) -> bool:
    return len(text) == 32 and all(digit in "0123456789abcdef" for digit in text)


def _tell(run: Run, message: ChainPerformance) -> None:
    """Tell a run how its chain goes."""
    succeeded, actions = Outcome.SUCCEEDED, message.actions
    run.actual[:] = [each.actual.duration for each in actions if each.outcome.code == succeeded]
    reason, told = printable(message.outcome.reason, _LONGEST), printable(message.refinement, _LONGEST)
    if not message.outcome.code:
        run.status = f"of others: {reason}"
        return
    done = message.outcome.code == succeeded
    run.duration = message.actual.duration if done else math.nan
    run.status = f"of others: {'done' if done else reason} ({told})"
    run.ended = True
