"""What the security policy allows a node, and what a running node uses."""

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from rclpy.node import Node, NodeNameNonExistentError
from ros_client import Client

from ator_ros.resources import share_folder

_ACTION = "/_action/"
POLICY = ET.parse(share_folder() / "security" / "ator_ros.policy.xml").getroot()  # noqa: S314, our own file


@dataclass(frozen=True, slots=True)
class Surface:
    """Full names of the topics, services and actions of one node.

    Parts of the actions that it executes or calls count as these.
    """

    publishes: frozenset[str]
    subscribes: frozenset[str]
    replies: frozenset[str]
    requests: frozenset[str]
    executes: frozenset[str]
    calls: frozenset[str]


def surface(observer: Node, name: str, namespace: str = "/") -> Surface:
    """Return the names of a node, as another node on its domain sees them.

    The namespace begins with a slash. Raises rclpy's NodeNameNonExistentError before it is
    discovered.
    """
    publishes = _names(observer.get_publisher_names_and_types_by_node(name, namespace))
    subscribes = _names(observer.get_subscriber_names_and_types_by_node(name, namespace))
    replies = _names(observer.get_service_names_and_types_by_node(name, namespace))
    requests = _names(observer.get_client_names_and_types_by_node(name, namespace))
    executes = _actions(replies)
    calls = _actions(requests)
    return Surface(
        publishes=_without(executes, publishes),
        subscribes=_without(calls, subscribes),
        replies=_without(executes, replies),
        requests=_without(calls, requests),
        executes=executes,
        calls=calls,
    )


def _names(names_and_types: Iterable[tuple[str, list[str]]]) -> frozenset[str]:
    # a lease has a random name; who needs one allows it apart (docs/security.md)
    return frozenset(name for name, _ in names_and_types if "/lease_" not in name)


def _without(actions: frozenset[str], names: frozenset[str]) -> frozenset[str]:
    return frozenset(name for name in names if name.partition(_ACTION)[0] not in actions)


def _actions(names: frozenset[str]) -> frozenset[str]:
    return frozenset(name.partition(_ACTION)[0] for name in names if _ACTION in name)


def allowed(node: str, namespace: str = "") -> Surface:
    """Return the full names that the profile of a node, here in another namespace, allows."""
    (profile,) = POLICY.iterfind(f".//profile[@node='{node}']")

    def full(name: str) -> str:
        own = name.replace("~", node, 1) if name.startswith("~") else name
        return name if name.startswith("/") else f"{namespace}/{own}"

    def names(kind: str, rule: str) -> frozenset[str]:
        lists = profile.iterfind(f"{kind}s[@{rule}='ALLOW']")
        return frozenset(full(item.text or "") for part in lists for item in part)

    return Surface(
        publishes=names("topic", "publish"),
        subscribes=names("topic", "subscribe"),
        replies=names("service", "reply"),
        requests=names("service", "request"),
        executes=names("action", "execute"),
        calls=names("action", "call"),
    )


def assert_profile(observer: Client, node: str, namespace: str = "") -> None:
    """Wait until a node uses exactly what its profile allows; show the difference otherwise."""
    profile = allowed(node, f"/{namespace}" if namespace else "")

    def opened() -> object:
        try:
            return surface(observer.node, node, f"/{namespace}")
        except NodeNameNonExistentError:
            return None

    try:
        observer.eventually(lambda: opened() == profile, "the node's whole profile")
    except AssertionError:
        assert opened() == profile  # a failing comparison shows the difference
