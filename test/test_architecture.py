"""The house: imports point down, and only the nodes and what runs them know ROS."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "ator_ros"
FLOORS = [
    "geometry",
    "printable",
    "resources",
    "files",
    "plain_yaml",
    "schema_hooks",
    "schema",
    "formats",
    "compile_cache",
    "compiled",
    "cores",
    "examples",
    "world",
    "robot",
    "drawing",
    "motion",
    "actions",
    "tops",
    "simulation",
    "experience",
    "performance",
    "refinement",
    "execution",
    "domains",
    "planning",
    "evaluation",
    "report",
    "learning",
    "viewing",
    "page",
    "nodes",
    "tools",
]
"""Modules and folders of the package, ground floor first; each imports only from itself and those before."""
WITH_ROS = {"examples", "nodes", "tools"}
ROS = {
    "action_msgs",
    "ator_interfaces",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "launch",
    "launch_ros",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "rosidl_parser",
    "rpyutils",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "unique_identifier_msgs",
    "visualization_msgs",
}
"""Packages of ROS; without `ament_index_python`, with which `resources` finds installed files."""
FILES = sorted(PACKAGE.rglob("*.py"))


def imports(file: Path) -> Iterator[str]:
    """Yield the dotted names of the modules that a file imports, at its head or in a function."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level:
            raise AssertionError(f"{file}:{node.lineno}: expected an absolute import")
        elif isinstance(node, ast.ImportFrom) and node.module == "ator_ros":
            yield from (f"ator_ros.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def floor_of(file: Path) -> str:
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def test_every_floor_is_known() -> None:
    assert {floor_of(file) for file in FILES} - {"__init__"} == set(FLOORS)


@pytest.mark.parametrize("floor", FLOORS)
def test_imports_point_down(floor: str) -> None:
    allowed = set(FLOORS[: FLOORS.index(floor) + 1])
    upward = {
        f"{file.relative_to(PACKAGE)} imports {name}"
        for file in FILES
        if floor_of(file) == floor
        for name in imports(file)
        if name.startswith("ator_ros.") and name.split(".")[1] not in allowed
    }
    assert not upward


def test_only_nodes_and_tools_know_ros() -> None:
    knowing = {floor_of(file) for file in FILES if {name.split(".")[0] for name in imports(file)} & ROS}
    assert knowing == WITH_ROS


@pytest.mark.parametrize(
    ("floor", "foreign"),
    [
        ("report", ("ator_ros.simulation", "ator_ros.evaluation.chain_run")),
        ("evaluation", ("ator_ros.drawing", "matplotlib")),
        ("learning", ("ator_ros.drawing", "matplotlib")),
    ],
)
def test_reports_execute_nothing_and_what_executes_draws_nothing(
    floor: str, foreign: tuple[str, ...]
) -> None:
    files = [file for file in FILES if floor_of(file) == floor]
    assert files
    assert [
        f"{file.name}: {name}" for file in files for name in imports(file) if name.startswith(foreign)
    ] == []


DOMAIN_WORDS = re.compile(
    r"\b(?:balls?|dribbl(?:e|es|ed|ing)|shoots?|shooting|shots?|kicks?|kicked|fins?|goalposts?|soccer|robocup"
    r"|pioneer)\b|\b(?:ball and|on|off) the field\b|\bfield's\b|\brobot(?:'s)? field\b|\bfield of\("
    r"|\btwo goals are\b|\bgoal(?:'s)? (?:mouth|line)\b"
)
"""Words of soccer and of one robot. "Field" is also one of a message, a file or a dataclass."""
SAID = {
    "domains/__init__.py": ('DEFAULT = "soccer"',),  # the default of `find_domain`
    "robot/description.py": ('"pioneer.yaml"',),  # the default description
    "examples/refine_and_execute.py": ("goToBall", "dribbleBall", '"ball"'),
    "evaluation/heuristics.py": ("RoboCup teams", "Booster's RoboCup demo"),  # where these models come from
}
"""What modules may say; None: anything."""
ROOT = PACKAGE.parent
EXAMPLES = {
    "ator_interfaces/msg/ObjectState.msg": ('for example "ball" in soccer',),
    "ator_interfaces/msg/GoalValue.msg": ("kick",),
    "ator_interfaces/msg/TopChain.msg": ('soccer has "default" and "bezier"',),
    "ator_interfaces/msg/TopCall.msg": (
        "soccer has goToPose, goToBall, dribbleBall and shoot",
        "in soccer the ball; for shoot it is the middle of the goal's mouth",
        "with dribbleBall the heading and the speed",
        "goToBall starts with the ball at x, y",
        "The actions of soccer declare none",
    ),
    "launch/ator.launch.xml": (
        "odom, ball and cmd_vel",
        "pioneer.yaml",
        "the simulated Pioneer",
    ),
}
"""What interfaces and the launch file may say, as examples from the default domain; None: anything."""
_OF_NODES = ("domain: soccer", "the shipped pioneer.yaml")
_OF_ROBOTS = ("pioneer.yaml", "ball: {radius: ")
CONFIGURING = {
    "config/executor.yaml": (*_OF_NODES, "soccer's object", "ball_"),
    "config/learning.yaml": _OF_NODES,
    "config/refinement.yaml": _OF_NODES,
    "config/simulation.yaml": (*_OF_NODES, "soccer's ball", "ball_"),
    "config/pioneer.yaml": None,  # the default robot on the field of the default domain
    "config/patrolbot.yaml": _OF_ROBOTS,
    "config/pioneer_lx.yaml": (*_OF_ROBOTS, "Pioneer LX", "name: pioneer_lx", "pioneer-lx.p"),
    "config/turtlebot4.yaml": _OF_ROBOTS,
    "security/ator_ros.policy.xml": ("<topic>ball</topic>", "<service>place_ball</service>"),
}
"""What files that configure the default domain, or a robot in its scene, may say; None: anything."""
CONFIGURATION = sorted(
    file
    for folder in ("config", "rviz", "security", "urdf")
    for file in (ROOT / folder).rglob("*")
    if file.is_file()
)
INTERFACES = sorted(
    file for suffix in ("msg", "srv", "action") for file in (ROOT / "ator_interfaces").rglob(f"*.{suffix}")
)


def says_domain_words(file: Path, allowed: tuple[str, ...] | None = ()) -> list[str]:
    """Return the words of a domain in a file, `ball_x` taken apart, except for what is allowed."""
    if allowed is None:
        return []
    text = file.read_text(encoding="utf-8")
    for phrase in allowed:
        assert phrase in text, f"{file}: expected {phrase!r}, which it may say"
        text = text.replace(phrase, "")
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", text).replace("_", " ")
    return DOMAIN_WORDS.findall(apart.lower())


def test_the_core_names_no_domain() -> None:
    core = {str(file.relative_to(PACKAGE)): file for file in FILES}
    rest = {name for name in core if not name.startswith("domains/soccer/")}
    saying = {name: words for name in rest if (words := says_domain_words(core[name], SAID.get(name, ())))}
    assert saying == {}


def test_interfaces_and_launch_name_a_domain_in_examples_only() -> None:
    files = {str(file.relative_to(ROOT)): file for file in (*INTERFACES, *(ROOT / "launch").iterdir())}
    assert EXAMPLES.keys() <= files.keys()
    saying = {
        name: words
        for name, file in files.items()
        if (words := says_domain_words(file, EXAMPLES.get(name, ())))
    }
    assert saying == {}


def test_configuration_names_a_domain_only_where_it_configures_it() -> None:
    files = {str(file.relative_to(ROOT)): file for file in CONFIGURATION}
    assert CONFIGURING.keys() <= files.keys()
    saying = {
        name: words
        for name, file in files.items()
        if (words := says_domain_words(file, CONFIGURING.get(name, ())))
    }
    assert saying == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ball_x = 1.0", ["ball"]),
        ("class ShootFar: ...", ["shoot"]),
        ("# around the ball and the field", ["ball"]),
        ("# as after a kick, toward the goal's mouth", ["kick", "goal's mouth"]),
        ("field = dataclasses.field(); a snapshot, finished; football of file and field", []),
    ],
)
def test_words_of_a_domain_are_noticed(tmp_path: Path, text: str, words: list[str]) -> None:
    file = tmp_path / "some.py"
    file.write_text(text, encoding="utf-8")
    assert says_domain_words(file) == words


def test_nodes_start_without_what_only_learning_needs() -> None:
    names = [f"ator_ros.nodes.{name}" for name in ("executor", "refinement", "simulation")]
    names.append("ator_ros.domains.soccer.domain")
    heavy = ["sklearn", "pandas", "pyarrow", "scipy.stats", "matplotlib", "viser", "unified_planning"]
    script = f"import sys, {', '.join(names)}; print([name for name in {heavy} if name in sys.modules])"
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert told.strip() == "[]"
