"""The configurations of RViz and Foxglove name what those programs know, and topics that our nodes have.

Neither program runs in the tests: `rviz_facts` holds what RViz's sources say.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from documentation import ROOT as CHECKOUT
from rviz_facts import DISPLAY, DISPLAYS, MESSAGES, PANELS, ROOT, TOOLS, VIEWS, WINDOW, faults

from ator_ros.resources import share_folder

RVIZ = yaml.safe_load((share_folder() / "rviz" / "ator.rviz").read_text(encoding="utf-8"))
ROOTED = RVIZ["Visualization Manager"]
FOXGLOVE = json.loads((share_folder() / "rviz" / "ator.foxglove.json").read_text(encoding="utf-8"))


def documented() -> dict[str, tuple[str, bool]]:
    """Return type of each topic in docs/view.md's table, and whether it is latched."""
    text = (CHECKOUT / "docs" / "view.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w/]+)` \| `([\w/]+)`([^|]*)\|", text, re.MULTILINE)
    return {topic: (kind, "latched" in rest) for topic, kind, rest in rows}


def with_topics() -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield each display or tool with a topic, and the topic's property."""
    for part in (*ROOTED["Displays"], *ROOTED["Tools"]):
        for name in ("Topic", "Description Topic"):
            if name in part:
                yield part, part[name]


@pytest.mark.parametrize(
    ("parts", "known"),
    [
        (ROOTED["Displays"], {name: DISPLAY | own for name, own in DISPLAYS.items()}),
        (ROOTED["Tools"], {name: {"Class": str} | own for name, own in TOOLS.items()}),
        (RVIZ["Panels"], {name: {"Class": str, "Name": str} | own for name, own in PANELS.items()}),
        ([ROOTED["Views"]["Current"], *ROOTED["Views"]["Saved"]], VIEWS),
    ],
    ids=["displays", "tools", "panels", "views"],
)
def test_rviz_knows_every_class_and_property(parts: list[dict[str, Any]], known: dict[str, Any]) -> None:
    assert {part["Class"] for part in parts} <= set(known)
    assert [fault for part in parts for fault in faults(part["Class"], part, known[part["Class"]])] == []


def test_rviz_knows_the_rest_of_the_file() -> None:
    assert set(RVIZ) == {"Panels", "Visualization Manager", "Window Geometry"}
    assert faults("root", ROOTED, ROOT) == []
    titles = {panel["Name"]: {"collapsed": bool} for panel in RVIZ["Panels"]}
    assert faults("window", RVIZ["Window Geometry"], WINDOW | titles) == []


def test_a_name_that_rviz_does_not_know_is_found() -> None:
    path = {"Class": "", "Topic": {"Value": "p", "Durability": "Volatile"}, "Line Style": "Dots", "Width": 1}
    found = faults("p", path, DISPLAY | DISPLAYS["rviz_default_plugins/Path"])
    assert found == ["p/Topic: no Durability", "p/Line Style: 'Dots'", "p: no Width"]


def test_its_topics_are_ours_with_their_types_and_state_is_asked_for_as_latched() -> None:
    ours = documented()
    for part, topic in with_topics():
        kind, latched = ours[topic["Value"]]
        assert kind == MESSAGES[part["Class"]], topic
        assert topic["Durability Policy"] == ("Transient Local" if latched else "Volatile"), topic


def test_everything_that_is_drawn_is_shown() -> None:
    drawn = {name for name, (kind, _) in documented().items() if kind in set(MESSAGES.values())}
    assert {topic["Value"] for _, topic in with_topics()} == drawn


def test_foxglove_shows_the_same_topics() -> None:
    panel = FOXGLOVE["configById"][FOXGLOVE["layout"]["first"]]
    (robot,) = [layer for layer in panel["layers"].values() if layer["layerId"] == "foxglove.Urdf"]
    shown = {name for name, settings in panel["topics"].items() if settings["visible"]}
    goal = panel["publish"]["poseTopic"]
    drawn = {f"/{topic['Value']}" for _, topic in with_topics()} - {"/odom"}  # shows no Odometry
    assert {*shown, robot["topic"], goal} == drawn
    assert panel["publish"]["type"] == "pose"
    assert panel["followTf"] == ROOTED["Global Options"]["Fixed Frame"]


def test_foxglove_lays_out_every_panel_once() -> None:
    def panels(part: Any) -> Iterator[str]:
        if isinstance(part, str):
            yield part
        else:
            assert part["direction"] in {"row", "column"}
            yield from panels(part["first"])
            yield from panels(part["second"])

    assert sorted(panels(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])
    kinds = {name.split("!")[0] for name in FOXGLOVE["configById"]}
    assert kinds <= {"3D", "Plot", "RawMessages", "DiagnosticSummary"}
