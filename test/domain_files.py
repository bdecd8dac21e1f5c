"""Domains as YAML files, valid and invalid, and as entry points of packages."""

import copy
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
import yaml

from ator_ros.domains import domain as domains

TOUR: dict[str, Any] = {
    "name": "errands",
    "objects": [{"name": "cart", "topic": "/cart/pose", "type": "PoseStamped", "optional": True}],
    "tops": [
        {
            "name": "visit",
            "action": "navigate",
            "pre": [
                {"variable": "cart.x", "target": 3, "tolerance": 2},
                {"variable": "robot.x", "target": 0.0, "low": 0.5},
            ],
            "post": [
                {"variable": "robot.x", "target": "goal.x", "tolerance": 0.25},
                {"variable": "robot.y", "target": "goal.y", "tolerance": 0.25},
            ],
        },
        {
            "name": "fetch",
            "action": "goToPose",
            "point": "hold",
            "post": [{"variable": "hold.x", "target": "cart.x", "tolerance": 0.1}],
        },
    ],
    "actions": [
        {
            "name": "navigate",
            "remote": {
                "server": "navigate_to_pose",
                "type": "nav2_msgs/action/NavigateToPose",
                "goal": [{"field": "pose", "source": "goal", "frame": "map"}],
                "success": {"fields": [{"field": "error_code", "equals": 0}]},
            },
        },
        {"name": "goToPose", "local": {"domain": "soccer"}},
    ],
    "variables": [{"name": "yaw"}, {"name": "speed", "low": 0.1, "high": 0.4}],
}


PLACE = {"x": [-1, 1], "y": [0.5]}
CHAIN: dict[str, Any] = {
    "name": "walk",
    "start": [PLACE],
    "steps": [{"top": "visit", "goal": [PLACE]}],
}


class _Plain(yaml.SafeDumper):
    """Writes no YAML aliases, since domain files must not contain them."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def file_of(folder: Path, data: object) -> Path:
    file = folder / "tour.yaml"
    file.write_text(
        data if isinstance(data, str) else yaml.dump(data, Dumper=_Plain), encoding="utf-8"
    )
    return file


def install(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    value: str,
    *,
    action_sets: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Install a single domain of this name with `value` as its entry point, and `action_sets`."""
    groups = {domains.GROUP: {name: value}, domains.ACTION_SETS: action_sets}

    def entry_points(group: str) -> list[EntryPoint]:
        installed = groups.get(group, {})
        return [EntryPoint(entry, module, group) for entry, module in installed.items()]

    monkeypatch.setattr(domains, "entry_points", entry_points)


def visiting(cart: dict[str, Any], target: str) -> dict[str, Any]:
    """Return a domain in which the only TOP drives to the `target`, goal or cart.

    `cart` is its source.
    """
    post = [{"variable": f"robot.{x}", "target": f"{target}.{x}", "tolerance": 0.1} for x in "xy"]
    return {
        "name": "errands",
        "objects": [{"name": "cart", **cart}],
        "tops": [{"name": "visit", "action": "goToPose", "post": post}],
        "actions": [{"name": "goToPose", "local": {"domain": "soccer"}}],
    }


def changed(path: str, value: object) -> dict[str, Any]:
    """Return the domain with the value at a path replaced, or a field added."""
    data = copy.deepcopy(TOUR)
    *outer, last = (int(key) if key.isdigit() else key for key in path.split("."))
    inner: Any = data
    for key in outer:
        inner = inner[key]
    inner[last] = value
    return data
