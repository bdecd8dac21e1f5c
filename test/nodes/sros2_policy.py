"""Reads an SROS2 policy, and says where it departs from SROS2's schema (policy.xsd, version 0.2.0)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

from graph import Surface

_CHILDREN = {
    "policy": {"enclaves"},
    "enclaves": {"enclave"},
    "enclave": {"profiles"},
    "profiles": {"profile"},
    "profile": {"topics", "services", "actions"},
    "topics": {"topic"},
    "services": {"service"},
    "actions": {"action"},
}
_RULES = {
    "topics": {"publish", "subscribe"},
    "services": {"reply", "request"},
    "actions": {"execute", "call"},
}
_REQUIRED = {"policy": {"version"}, "enclave": {"path"}, "profile": {"ns", "node"}}


def read_policy(file: Path) -> ET.Element:
    """Parse a policy of ours."""
    return ET.parse(file).getroot()  # noqa: S314, the file is ours


def faults(element: ET.Element) -> Iterator[str]:
    """Yield in words what the schema does not allow in an element and below it."""
    tag, attributes = element.tag, set(element.attrib)
    if tag in _RULES:
        if not attributes or not attributes <= _RULES[tag]:
            yield f"{tag}: expected attributes of {sorted(_RULES[tag])}, got {sorted(attributes)}"
        if set(element.attrib.values()) - {"ALLOW", "DENY"}:
            yield f"{tag}: expected ALLOW or DENY, got {sorted(element.attrib.values())}"
    elif attributes != _REQUIRED.get(tag, set()):
        yield f"{tag}: expected the attributes {sorted(_REQUIRED.get(tag, ()))}, got {sorted(attributes)}"
    if tag in _CHILDREN and not len(element):
        yield f"{tag}: expected {sorted(_CHILDREN[tag])}, got nothing"
    if tag not in _CHILDREN and not (element.text or "").strip():
        yield f"{tag}: expected a name, got none"
    for child in element:
        if child.tag not in _CHILDREN.get(tag, set()):
            yield f"{tag}: expected {sorted(_CHILDREN.get(tag, ()))}, got {child.tag}"
        yield from faults(child)


def allowed(policy: ET.Element, node: str) -> Surface:
    """Return what the profile of a node allows it to open, with full names."""
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
