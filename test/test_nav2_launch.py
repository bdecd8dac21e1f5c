"""The launch file beside Nav2 starts installed nodes with files that are made for them.

The file is parsed as XML, since `ros2 launch` is not available as a wheel.
"""

import re
import shlex
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from xml.etree import ElementTree as ET

from ator_ros.resources import PACKAGE, share_folder

LAUNCH = ET.parse(share_folder() / "launch" / "nav2.launch.xml").getroot()  # noqa: S314 - our own file
NODES = {node.get("exec"): node for node in LAUNCH.iter("node")}
ARGUMENTS = {entry.get("name"): entry.get("default", "") for entry in LAUNCH.findall("arg")}


def setup_command() -> list[str]:
    """Return the command that finds out about Nav2, with the default arguments."""
    (found,) = LAUNCH.findall("let")
    words = found.get("value", "").removeprefix("$(command '").removesuffix("')")
    for name, default in ARGUMENTS.items():
        words = words.replace(f"$(var {name})", default.replace("$(env HOME)", "~"))
    return [sys.executable, *shlex.split(words)[1:]]


def test_it_starts_our_nodes_in_one_namespace_with_the_files_that_were_made() -> None:
    assert set(NODES) == {"watch", "learning", "refinement", "executor", "waypoints"}
    assert set(NODES) <= {script.name for script in entry_points(group="console_scripts")}
    (group,) = LAUNCH.findall("group")
    assert group.find("push_ros_namespace").get("namespace") == "$(var namespace)"  # type: ignore[union-attr]
    for node in NODES.values():
        assert node.get("pkg") == PACKAGE
        files = [param.get("from") for param in node.iter("param") if param.get("from")]
        assert files == ["$(var found)/nav2.yaml"]


def test_nodes_that_use_tf_follow_its_namespace() -> None:
    for name in ("watch", "executor", "waypoints"):
        remaps = {item.get("from"): item.get("to") for item in NODES[name].iter("remap")}
        assert remaps == {"/tf": "tf", "/tf_static": "tf_static"}


def test_without_nav2_one_line_names_the_argument() -> None:
    command = setup_command()
    command[command.index("--wait") + 1] = "0"
    command[command.index("--folder") + 1] = "unused"
    # other tests may run nodes of Nav2
    command[command.index("--namespace=")] = "--namespace=robot_without_nav2"
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert re.fullmatch(r"nav2: expected .*, got none; start Nav2, or set frame:=map\n",
                        done.stderr)  # fmt: skip


def test_the_document_lists_the_arguments() -> None:
    text = (Path(__file__).resolve().parents[1] / "docs" / "nav2.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"\| argument \|.*?\n\n", text, flags=re.DOTALL)
    cells = [row.split("|")[1] for row in table.strip().splitlines()[2:]]
    listed = set(re.findall(r"`(\w+)`", " ".join(cells)))
    assert listed == set(ARGUMENTS)
