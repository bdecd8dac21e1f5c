"""The soak's side of ROS: the demo's, and how long the executor takes to answer odometry."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from ator_ros.nodes.qos import COMMANDS
from ator_ros.tools.work.demo_client import DemoClient
from ator_ros.tools.work.soak_report import Answer
from ator_ros.world.messages import seconds_from


class SoakClient(DemoClient):
    """As `DemoClient`; `take_answers` gives when odometry came, and the command that answered it.

    Both arrive in this process, so that the times hold what its own thread delays, too.
    """

    def __init__(
        self, domain: int, check: Callable[[], None], objects: Sequence[str], patience: float = 40.0
    ) -> None:
        self._stamp = 0.0
        self._came: float | None = None
        self._answers: list[Answer] = []
        super().__init__(domain, check, objects, patience)
        self._own.node.create_subscription(Twist, "cmd_vel", self._hear_command, COMMANDS)

    def _hear(self, message: Odometry) -> None:
        super()._hear(message)
        stamp = seconds_from(message.header.stamp)
        if stamp != self._stamp:  # a paused world is published, too, and has no answer
            self._stamp, self._came = stamp, time.monotonic()

    def _hear_command(self, _: Twist) -> None:
        if self._came is not None:
            self._answers.append(Answer(self._stamp, self._came, time.monotonic()))
            self._came = None

    def take_answers(self) -> list[Answer]:
        """Return the answers since the last call."""
        taken, self._answers = self._answers, []
        return taken
