"""The topics, services and actions of a node, from the ROS graph."""

from collections.abc import Iterable
from dataclasses import dataclass

from rclpy.node import Node

_ACTION = "/_action/"


@dataclass(frozen=True, slots=True)
class Surface:
    """Full names of the topics, services and actions of one node; parts of an action count as the action."""

    publishes: frozenset[str]
    subscribes: frozenset[str]
    replies: frozenset[str]
    requests: frozenset[str]
    executes: frozenset[str]
    calls: frozenset[str]


def surface(observer: Node, name: str, namespace: str = "/") -> Surface:
    """Return the names of a node, as another node on its domain sees them.

    The namespace begins with a slash. Raises rclpy's NodeNameNonExistentError before it is discovered.
    """
    replies = _names(observer.get_service_names_and_types_by_node(name, namespace))
    requests = _names(observer.get_client_names_and_types_by_node(name, namespace))
    return Surface(
        publishes=_plain(_names(observer.get_publisher_names_and_types_by_node(name, namespace))),
        subscribes=_plain(_names(observer.get_subscriber_names_and_types_by_node(name, namespace))),
        replies=_plain(replies),
        requests=_plain(requests),
        executes=_actions(replies),
        calls=_actions(requests),
    )


def _names(names_and_types: Iterable[tuple[str, list[str]]]) -> frozenset[str]:
    return frozenset(name for name, _ in names_and_types)


def _plain(names: frozenset[str]) -> frozenset[str]:
    return frozenset(name for name in names if _ACTION not in name)


def _actions(names: frozenset[str]) -> frozenset[str]:
    return frozenset(name.partition(_ACTION)[0] for name in names if _ACTION in name)
