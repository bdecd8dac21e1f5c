"""Inputs that gather while a node rests."""

from __future__ import annotations

import contextlib
from typing import Any, Protocol, runtime_checkable

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.subscription import Subscription


class Gathering(MutuallyExclusiveCallbackGroup):
    """Subscriptions that wake their node up, except while it rests: then it takes the newest now and then.

    What else the node waits for, such as a goal, wakes it up at any time. At each awakening rclpy collects
    anew all that it waits for, and it makes a task of each message. With 40 messages a second this was most
    of what an idle node took of the processor.
    """

    def __init__(self) -> None:
        super().__init__()
        self._held = False
        self._subscriptions: list[Subscription] = []

    def add_entity(self, entity: Any) -> None:
        """Add a subscription, or an event of one; rclpy calls this where one is created with this group."""
        super().add_entity(entity)
        if isinstance(entity, Subscription):
            self._subscriptions.append(entity)

    def can_execute(self, entity: Any) -> bool:
        """Return whether a subscription may wake the node up."""
        return not self._held and super().can_execute(entity)

    def rest(self, executor: Executor, seconds: float) -> None:
        """Wait for everything else for some real seconds; then take what has come meanwhile.

        Parameters
        ----------
        executor : Executor
            Spins the node.
        seconds : float
            It is less where something else happens before.
        """
        self._held = True
        try:
            executor.spin_once(timeout_sec=seconds)
        finally:
            self._held = False
        self._take()

    def _take(self) -> None:
        """Take the newest messages, in the order in which the subscriptions were created."""
        for subscription in self._subscriptions:
            newest = _newest(subscription)
            if newest is not None:
                subscription.callback(newest)


def _newest(subscription: Subscription) -> Any:
    """Return the last message that has come; None where none has, or the subscription was destroyed."""
    newest = None
    handle, kind, raw = subscription.handle, subscription.msg_type, subscription.raw
    with contextlib.suppress(InvalidHandle), handle:
        while (taken := handle.take_message(kind, raw)) is not None:
            newest = taken[0]
    return newest


@runtime_checkable
class Resting(Protocol):
    """A node that may rest.

    Attributes
    ----------
    gathering : Gathering
        What gathers meanwhile.
    """

    gathering: Gathering

    def rest(self) -> float:
        """Return for how many real s inputs may gather; 0 where they are to be taken as they come."""
