"""The layers: imports point down, and only nodes and what uses them depend on ROS."""

import ast
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from token import NAME
from tokenize import tokenize

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "ator_ros"
LAYERS = [
    "start", "geometry", "printable", "resources", "schema", "files", "compiled", "world", "bases",
    "actions", "tops", "simulation", "experience", "performance", "refinement", "execution",
    "domains", "planning", "evaluation", "learning", "nodes", "view", "tools",
]  # fmt: skip
"""Modules and folders of the package, lowest first; each imports from itself and lower ones."""
WITH_ROS = {"nodes", "tools", "view"}
ROS = {
    "action_msgs", "ator_interfaces", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs",
    "launch",
    "launch_ros", "nav_msgs", "rcl_interfaces", "rclpy", "rosgraph_msgs", "sensor_msgs", "std_msgs",
    "std_srvs", "tf2_msgs", "unique_identifier_msgs", "visualization_msgs",
}  # fmt: skip
"""Packages of ROS, without `ament_index_python`, which `resources` uses to find installed files."""
FILES = sorted(PACKAGE.rglob("*.py"))
PAPER = PACKAGE.parent / "examples" / "paper_in_one_file.py"


@cache
def imports(file: Path) -> tuple[str, ...]:
    """Return the dotted names of the modules that a file imports."""
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level:
            raise AssertionError(f"{file}:{node.lineno}: expected an absolute import")
        elif isinstance(node, ast.ImportFrom) and node.module == "ator_ros":
            names += [f"ator_ros.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.append(node.module)
    return tuple(names)


def layer_of(file: Path) -> str:
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def test_every_layer_is_listed() -> None:
    assert {layer_of(file) for file in FILES} - {"__init__"} == set(LAYERS)


@pytest.mark.parametrize("layer", LAYERS)
def test_imports_point_down(layer: str) -> None:
    allowed = set(LAYERS[: LAYERS.index(layer) + 1])
    upward = {
        f"{file.relative_to(PACKAGE)} imports {name}"
        for file in FILES
        if layer_of(file) == layer
        for name in imports(file)
        if name.startswith("ator_ros.") and name.split(".")[1] not in allowed
    }
    assert not upward


def test_no_two_files_have_one_name() -> None:
    names = Counter(file.name for file in FILES if file.name != "__init__.py")
    assert [name for name, count in names.items() if count > 1] == []


GENERAL = (
    "actions",
    "tops",
    "planning",
    "refinement",
    "execution",
    "performance",
    "experience",
    "world",
    "bases",
)


def test_general_rooms_name_no_ball() -> None:
    files = [file for file in FILES if layer_of(file) in GENERAL or "planned" in file.parts]
    found = set()
    for file in files:
        with file.open("rb") as source:
            names = [item.string for item in tokenize(source.readline) if item.type == NAME]
        found |= {f"{file.name}: {name}" for name in names if "ball" in name.lower().split("_")}
    assert not found


def test_only_soccer_imports_soccer_among_domains() -> None:
    soccer = "ator_ros.domains.soccer"
    folder = PACKAGE / "domains"
    importing = {
        file.relative_to(folder).parts[0]
        for file in FILES
        if layer_of(file) == "domains" and any(name.startswith(soccer) for name in imports(file))
    }
    assert importing == {"soccer"}


def test_nothing_imports_the_examples() -> None:
    roots = {name.split(".")[0] for file in FILES for name in imports(file)}
    assert not roots & {"ator_ros_examples", "examples"}


@pytest.mark.parametrize("law", ["navfn", "pursuit", "rotate_drive_rotate"])
def test_control_laws_are_independent_of_ator_ros(law: str) -> None:
    names = set(imports(PACKAGE.parent / "ator_ros_examples" / f"{law}.py"))
    ours = {name for name in names if name.startswith("ator_ros.")}
    assert not ours - {"ator_ros.compiled"}
    assert not {name.split(".")[0] for name in names} & ROS


def test_only_tools_import_the_laboratory() -> None:
    importing = {
        layer_of(file)
        for file in FILES
        if any(name.startswith("ator_ros.evaluation") for name in imports(file))
    }
    assert importing == {"evaluation", "tools"}


def test_the_paper_in_one_file_imports_only_simulation_and_actions() -> None:
    layers = {name.split(".")[1] for name in imports(PAPER) if name.startswith("ator_ros.")}
    assert layers == {"actions", "domains", "geometry", "simulation", "world"}


def test_only_nodes_and_what_uses_them_import_ros() -> None:
    importing = {
        layer_of(file) for file in FILES if {name.split(".")[0] for name in imports(file)} & ROS
    }
    assert importing == WITH_ROS


def test_nodes_start_without_the_packages_of_learning() -> None:
    names = [f"ator_ros.nodes.{name}" for name in ("executor", "refinement", "simulation")]
    names.append("ator_ros.domains.soccer.soccer_domain")
    heavy = ["sklearn", "pandas", "pyarrow", "scipy.stats", "matplotlib", "viser"]
    script = (
        f"import sys, {', '.join(names)}; print([name for name in {heavy} if name in sys.modules])"
    )
    output = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout
    assert output.strip() == "[]"
