"""Parameter defaults are defined in the nodes; files and documentation agree with them."""

import re
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml

from ator_ros.nodes import executor, goal_pose, learning, refinement, simulation, watch, waypoints
from ator_ros.nodes.parameters import Parameter
from ator_ros.tools import calibrate

ROOT = Path(__file__).parents[2]
NODES: dict[str, Sequence[Parameter]] = {
    "executor": executor.parameters_for(["ball"]),
    "simulation": simulation.parameters_for(["ball"]),
    "refinement": refinement.PARAMETERS,
    "learning": learning.PARAMETERS,
    "goal_pose": goal_pose.PARAMETERS,
    "watch": watch.PARAMETERS,
    "waypoints": waypoints.PARAMETERS,
}


@pytest.mark.parametrize("name", ["executor", "simulation", "refinement", "learning"])
def test_the_shipped_file_has_all_parameters_with_their_defaults(name: str) -> None:
    content = yaml.safe_load((ROOT / "config" / f"{name}.yaml").read_text(encoding="utf-8"))
    assert content[f"/**/{name}"]["ros__parameters"] == {
        item.name: item.default for item in NODES[name]
    }


def test_numbers_of_a_parameter_on_pages_are_its_default() -> None:
    numbers = {
        item.name: float(item.default)
        for parameters in NODES.values()
        for item in parameters
        if isinstance(item.default, float)
    }
    pages = [*(ROOT / "docs").glob("*.md"), ROOT / "README.md"]
    text = " ".join(" ".join(page.read_text(encoding="utf-8").split()) for page in pages)
    found = re.findall(r"(half of )?`(\w+)` \((\d+(?:\.\d+)?) s[;,)]", text)
    given = {
        (name, float(value) * (2.0 if half else 1.0))
        for half, name, value in found
        if name in numbers
    }
    assert given
    assert given == {(name, numbers[name]) for name, _ in given}


def test_the_launch_file_and_the_tools_have_the_same_defaults() -> None:
    defaults = {
        item.name: item.default for name in ("simulation", "goal_pose") for item in NODES[name]
    }
    launch = (ROOT / "launch" / "ator.launch.xml").read_text(encoding="utf-8")
    found = re.findall(r'<arg name="(\w+)" default="([^"$]*)"', launch)
    args = {name: yaml.safe_load(default) for name, default in found}
    shared = {"frame", "real_time_factor", "publish_clock"}
    assert {name: args[name] for name in shared} == {name: defaults[name] for name in shared}
    assert calibrate.arguments().get_default("frame") == defaults["frame"]
    stamped = next(item for item in NODES["executor"] if item.name == "stamped_commands")
    assert calibrate.arguments().get_default("stamped") == stamped.default
