"""The soak's side of ROS: the demo's, and how long the executor takes to answer odometry."""

from __future__ import annotations

import time
from collections.abc import Callable

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from ator_ros.nodes.node_support import COMMANDS
from ator_ros.tools.demo_client import DemoClient


class SoakClient(DemoClient):
    """As `DemoClient`; `take_answers` gives the times from an odometry message to the next command.

    Both arrive in this process, so that the times hold what its own thread delays, too.
    """

    def __init__(self, domain: int, check: Callable[[], None], patience: float = 40.0) -> None:
        self._odom_came: float | None = None
        self._answers: list[float] = []
        super().__init__(domain, check, patience)
        self._node.create_subscription(Twist, "cmd_vel", self._hear_command, COMMANDS)

    def _hear(self, message: Odometry) -> None:
        super()._hear(message)
        self._odom_came = time.monotonic()

    def _hear_command(self, _: Twist) -> None:
        if self._odom_came is not None:
            self._answers.append(time.monotonic() - self._odom_came)
            self._odom_came = None

    def take_answers(self) -> list[float]:
        """Give the times in s since the last call."""
        taken, self._answers = self._answers, []
        return taken
