"""What a view hears of the nodes besides the state: executed chains, planned ways, learned models."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from rclpy.node import Node
from rclpy.qos import QoSProfile

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.geometry import FloatArray
from ator_ros.nodes.qos import LATCHED, RESULTS
from ator_ros.printable import printable
from ator_ros.viewing.history import History
from ator_ros.viewing.recorded import driven_of
from ator_ros.world.messages import MessageError

_LONGEST = 300
_NEW, _SWITCH, _ERROR = "records since the last round", "last switch", ": error on the newest"
_RECORDS = QoSProfile(depth=100, reliability=LATCHED.reliability, durability=LATCHED.durability)


class Heard:
    """Listens to executor and refinement of one namespace.

    Parameters
    ----------
    node : Node
        Who listens.

    Attributes
    ----------
    history : History
        The executed chains, the one before it began to listen included.
    way : ndarray, shape (n, 2), or None
        The way that the action under way has planned, x and y in m; None without one.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.history = History()
        self._told: dict[str, str] = {}
        self.way: FloatArray | None = None
        self._tellers = {
            node.resolve_service_name("refinement"): _set_in_use,
            node.resolve_service_name("learning"): _progress,
            "/learning": _progress,  # one may learn for all robots
        }
        node.create_subscription(ChainPerformance, "performance/chain", self._take_record, _RECORDS)
        node.create_subscription(Path, "planned_path", self._take_path, LATCHED)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._take_health, RESULTS)

    def _take_record(self, message: ChainPerformance) -> None:
        if message.outcome.code == Outcome.REFUSED:  # it never ran
            return
        try:
            self.history.add(driven_of(message))
        except MessageError as error:
            self._node.get_logger().warning(f"ignored: {error}", throttle_duration_sec=2.0)

    def _take_path(self, message: Path) -> None:
        places = [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]
        self.way = np.array(places) if places and np.isfinite(places).all() else None

    def _take_health(self, message: DiagnosticArray) -> None:
        for status in message.status:
            tell = self._tellers.get(status.name)
            if tell is not None:
                values = {value.key: value.value for value in status.values}
                self._told[status.name] = printable(tell(values), _LONGEST)

    @property
    def learned(self) -> str:
        """The report on the learned models in use and on learning; empty where nothing is learned."""
        return "; ".join(said for said in tuple(self._told.values()) if said)


def _set_in_use(values: Mapping[str, str]) -> str:
    """Return what the node `refinement` tells."""
    return values.get("learned set", "")


def _progress(values: Mapping[str, str]) -> str:
    """Return what the node `learning` tells: what it does, and errors of old and new models."""
    said = [f"learning is {values.get('learning', '')}"]
    said += [f"{name}: {values[name]}" for name in (_NEW, _SWITCH) if name in values]
    return ", ".join(said + [f"{name} {value}" for name, value in values.items() if _ERROR in name])
