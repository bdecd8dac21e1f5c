"""Keeps account of all performance records that an executor announces."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile
from ros_client import Client

from ator_interfaces.msg import ActionPerformance, ChainPerformance
from ator_ros.nodes.qos import LATCHED, RESULTS

_PATIENCE = 10.0


class Ledger:
    """Listens from the first record to the last; its client outlives the executors.

    Parameters
    ----------
    client : Client
        On the domain of the executor, closed by whoever made it.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._actions: list[ActionPerformance] = []
        self._chains: list[ChainPerformance] = []
        self._expected: dict[str, str] = {}
        self._matched = {"performance/action": 0, "performance/chain": 0}
        self._listen(ActionPerformance, "performance/action", RESULTS, self._actions)
        self._listen(ChainPerformance, "performance/chain", LATCHED, self._chains)

    def _listen(self, kind: type, topic: str, qos: QoSProfile, heard: list[Any]) -> None:
        def count(matched: Any) -> None:
            self._matched[topic] = matched.total_count

        events = SubscriptionEventCallbacks(matched=count)
        self._client.node.create_subscription(kind, topic, heard.append, qos, event_callbacks=events)

    def listens_to(self, executors: int) -> bool:
        """Return whether it hears the latest of so many executors that were started one after the other."""
        return min(self._matched.values()) >= executors

    def expect(self, record: ChainPerformance) -> None:
        """Note a record that came as a goal's result: it must be announced, too."""
        self._expected[record.chain_id] = str(record)

    def check(self) -> None:
        """Make sure that no record is missing, that none came twice, and that all say the same."""
        for chain_id, record in self._expected.items():
            self._until(lambda i=chain_id, r=record: r in self._records()[i], f"the record of {chain_id}")
        for chain in list(self._chains):
            self._until(
                lambda c=chain: self._steps()[c.chain_id] == [str(a) for a in c.actions],
                f"each of the {len(chain.actions)} records of actions of {chain.chain_id}, once",
            )
        assert all(len(records) == 1 for records in self._records().values())

    def _until(self, happened: Callable[[], bool], what: str) -> None:
        self._client.eventually(happened, what, _PATIENCE)

    def _records(self) -> dict[str, list[str]]:
        """Return the records of chains by chain; as text, since NaN differs from itself."""
        return by_chain(self._chains)

    def _steps(self) -> dict[str, list[str]]:
        """Return the records of actions by chain."""
        return by_chain(self._actions)


def by_chain(records: list[ChainPerformance] | list[ActionPerformance]) -> dict[str, list[str]]:
    """Sort records, as text, by the chain that they belong to."""
    sorted_records: dict[str, list[str]] = defaultdict(list)
    for record in list(records):
        sorted_records[record.chain_id].append(str(record))
    return sorted_records
