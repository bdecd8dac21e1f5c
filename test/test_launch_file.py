"""The launch file starts installed executables, with existing files and parameters.

The file is parsed as XML, since `ros2 launch` is not available as a wheel.
"""

import re
import shlex
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.field import BALL
from ator_ros.nodes.executor import parameters_for as of_executor
from ator_ros.nodes.learning import PARAMETERS as LEARNING
from ator_ros.nodes.refinement import PARAMETERS as REFINEMENT
from ator_ros.nodes.simulation import parameters_for as of_simulation
from ator_ros.resources import PACKAGE, share_folder
from ator_ros.simulation.urdf import robot_urdf

LAUNCH = ET.parse(share_folder() / "launch" / "ator.launch.xml").getroot()  # noqa: S314 - our own file
OURS = {node.get("exec"): node for node in LAUNCH.iter("node") if node.get("pkg") == PACKAGE}
VIEW = OURS.pop("view")
GOAL_POSE = OURS.pop("goal_pose")
CONFIG = share_folder() / "config"
PARAMETERS = {
    "simulation": of_simulation([BALL]),
    "executor": of_executor([BALL]),
    "refinement": REFINEMENT,
    "learning": LEARNING,
}


def command_of(value: str, **given: Path) -> list[str]:
    command = value.removeprefix("$(command '").removesuffix("')")
    for name, path in given.items():
        command = command.replace(f"$(var {name})", str(path))
    return [sys.executable, *shlex.split(command)[1:]]


def test_it_starts_the_nodes_in_one_namespace() -> None:
    assert set(OURS) == set(PARAMETERS)
    assert set(OURS) <= {script.name for script in entry_points(group="console_scripts")}
    (group,) = LAUNCH.findall("group")
    assert group.find("push_ros_namespace").get("namespace") == "$(var namespace)"  # type: ignore[union-attr]
    assert set(group.findall("node")) >= set(OURS.values())


@pytest.mark.parametrize("name", PARAMETERS)
def test_parameters_are_those_of_the_nodes_in_their_files(name: str) -> None:
    files = [param.get("from", "") for param in OURS[name].iter("param") if param.get("from")]
    assert files == [f"$(var config)/{name}.yaml"]
    named = {param.get("name") for param in OURS[name].iter("param") if param.get("name")}
    assert named <= {parameter.name for parameter in PARAMETERS[name]}


def test_robot_state_publisher_has_the_description_of_the_given_robot() -> None:
    (publisher,) = [
        node for node in LAUNCH.iter("node") if node.get("pkg") == "robot_state_publisher"
    ]
    (value,) = [param.get("value", "") for param in publisher.iter("param")]
    words = command_of(value, robot=CONFIG / "pioneer.yaml")
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert printed.strip() == robot_urdf(load_robot(CONFIG / "pioneer.yaml")).strip()


def value_of(node: ET.Element, name: str) -> str:
    (value,) = [param.get("value", "") for param in node.iter("param") if param.get("name") == name]
    return value


def default_of(argument: str) -> str:
    (entry,) = [entry for entry in LAUNCH.findall("arg") if entry.get("name") == argument]
    return entry.get("default", "")


def test_rviz_starts_goal_pose_even_without_the_simulation() -> None:
    (rviz,) = [node for node in LAUNCH.iter("node") if node.get("pkg") == "rviz2"]
    assert rviz.get("if") == GOAL_POSE.get("if") == "$(var rviz)"
    assert {rviz, GOAL_POSE} <= set(LAUNCH.findall("group")[0])


def test_robot_and_domain_are_passed_to_every_node() -> None:
    for node in (*OURS.values(), GOAL_POSE):
        assert value_of(node, "domain") == "$(var domain)", node.get("exec")
        assert value_of(node, "robot") == "$(var robot)", node.get("exec")
    assert {"$(var domain)", "$(var robot)"} <= set(
        re.findall(r"\$\(var \w+\)", VIEW.get("args", ""))
    )
    (publisher,) = [
        node for node in LAUNCH.iter("node") if node.get("pkg") == "robot_state_publisher"
    ]
    assert "$(var robot)" in value_of(publisher, "robot_description")


@pytest.mark.parametrize(
    ("content", "domain"),
    [
        (None, ""),  # the shipped one: determined by the robot
        ("/**/executor:\n  ros__parameters:\n    domain: tour\n", "tour"),
        ("{", ""),
    ],
)
def test_defaults_of_robot_and_domain_are_those_of_the_configuration(
    tmp_path: Path, content: str | None, domain: str
) -> None:
    # a copy of the folder has its own robot
    assert default_of("robot") == "$(var config)/pioneer.yaml"
    folder = CONFIG if content is None else tmp_path
    if content is not None:
        (tmp_path / "executor.yaml").write_text(content, encoding="utf-8")
    done = subprocess.run(
        command_of(default_of("domain"), config=folder), capture_output=True, text=True
    )
    # launch fails on any other output
    assert (done.returncode, done.stdout, done.stderr) == (0, domain, "")


def test_the_document_lists_the_arguments() -> None:
    text = (Path(__file__).resolve().parents[1] / "docs" / "install.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"\| argument \|.*?\n\n", text, flags=re.DOTALL)
    cells = [row.split("|")[1] for row in table.strip().splitlines()[2:]]
    listed = set(re.findall(r"`(\w+)`", " ".join(cells)))
    assert listed == {entry.get("name") for entry in LAUNCH.findall("arg")}
