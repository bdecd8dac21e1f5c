"""Reads an SROS2 policy."""

from pathlib import Path
from xml.etree import ElementTree as ET

from graph import Surface


def read_policy(file: Path) -> ET.Element:
    return ET.parse(file).getroot()  # noqa: S314, a file of this package


def allowed(policy: ET.Element, node: str, namespace: str = "") -> Surface:
    """Return the full names that the profile of a node, here in another namespace, allows."""
    (profile,) = policy.iterfind(f".//profile[@node='{node}']")

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
