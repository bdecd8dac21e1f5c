"""Outside bases, their simulation and planned actions nothing knows how a robot moves."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "ator_ros"
PLANNED = (
    "planned/",
    *(f"soccer/{name}" for name in ("planned/", "go_to_ball", "holding", "shoot")),
)
KNOWING = ("bases/", "simulation/", *(f"domains/{place}" for place in PLANNED))
IDENTIFIES = ("tools/calibrate.py",)
"""The tool that has a base with two driven wheels identified: it may import what does that."""
OTHERS = [
    file
    for file in sorted(PACKAGE.rglob("*.py"))
    if not file.relative_to(PACKAGE).as_posix().startswith(KNOWING)
]
KINDS = ("ator_ros.bases.differential", "ator_ros.bases.omni")
NAMES = {
    "DifferentialRobot", "Limits", "StopBraking", "differential", "wheel_radius", "wheel_torque",
    "motor_time_constant", "grip", "v_back", "turn_time", "drive_time", "backward_above",
    "plain_driving",
    "fastest_paths", "OmniBase", "OmniRobot", "OmniLimits", "omnidirectional", "PlanarPlan",
    "v_side", "a_side",
}  # fmt: skip
"""Names of the bases that ship."""
OF_ROBOTS = {"limits", "stop", "track", "v"}
"""Attributes of such bases whose names others have, too."""


def known(file: Path) -> Iterator[str]:
    may_import = file.relative_to(PACKAGE).as_posix() in IDENTIFIES
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        of_base = isinstance(node, ast.ImportFrom) and (node.module or "").startswith(KINDS)
        if of_base and not may_import:
            yield f"line {node.lineno}: import from {node.module}"
        elif isinstance(node, ast.Name) and node.id in NAMES:
            yield f"line {node.lineno}: {node.id}"
        elif isinstance(node, ast.Attribute) and node.attr in NAMES:
            yield f"line {node.lineno}: .{node.attr}"
        elif isinstance(node, ast.Attribute) and node.attr in OF_ROBOTS:
            owner = ast.unparse(node.value).rpartition(".")[2].lstrip("_")
            if owner == "robot":
                yield f"line {node.lineno}: robot.{node.attr}"


@pytest.mark.parametrize("file", OTHERS, ids=lambda file: file.relative_to(PACKAGE).as_posix())
def test_nothing_else_knows_how_a_robot_moves(file: Path) -> None:
    assert not list(known(file))
