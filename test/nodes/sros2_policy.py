"""Reads an SROS2 policy, and reports violations of SROS2's schema (policy.xsd, version 0.2.0)."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from graph import Surface


def read_policy(file: Path) -> ET.Element:
    """Parse a policy."""
    return ET.parse(file).getroot()  # noqa: S314, a file of this package


def allowed(policy: ET.Element, node: str) -> Surface:
    """Return the full names that the profile of a node allows."""
    (profile,) = policy.iterfind(f".//profile[@node='{node}']")

    def names(kind: str, rule: str) -> frozenset[str]:
        lists = profile.iterfind(f"{kind}s[@{rule}='ALLOW']")
        return frozenset(_full(item.text or "", profile) for part in lists for item in part)

    return Surface(
        publishes=names("topic", "publish"),
        subscribes=names("topic", "subscribe"),
        replies=names("service", "reply"),
        requests=names("service", "request"),
        executes=names("action", "execute"),
        calls=names("action", "call"),
    )


def _full(name: str, profile: ET.Element) -> str:
    namespace = profile.attrib["ns"].rstrip("/")
    if name.startswith("/"):
        return name
    own = name.replace("~", profile.attrib["node"], 1) if name.startswith("~") else name
    return f"{namespace}/{own}"
