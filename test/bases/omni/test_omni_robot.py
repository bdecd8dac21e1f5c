"""The description of an omnidirectional robot."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from omni_robots import ALIKE, FILES, ROBOTS, UNLIKE, WITH_HOLDER
from robots import PIONEER, loaded

from ator_ros.bases.description import ConfigError, load_robot
from ator_ros.bases.differential.robot import differential
from ator_ros.bases.omni.omni_robot import OmniBase, OmniRobot, omnidirectional
from ator_ros.domains.domain import domain_for


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_shipped_descriptions_are_read_and_written_again(file: Path, tmp_path: Path) -> None:
    robot = load_robot(file)
    assert robot.name == file.stem
    assert loaded(robot.sections(), tmp_path) == robot
    assert domain_for("", file).name == "drive"


def test_one_with_a_holder_is_read_as_written(tmp_path: Path) -> None:
    assert loaded(WITH_HOLDER.sections(), tmp_path) == WITH_HOLDER
    assert WITH_HOLDER.greatest_speed(holding=True) == 1.0


def test_without_a_body_it_is_for_action_servers_only(tmp_path: Path) -> None:
    sections = ALIKE.sections()
    for name in ("mass", "motor_time_constant"):
        del sections["robot"][name]
    robot = loaded(sections, tmp_path)
    assert isinstance(robot, OmniBase)
    assert not isinstance(robot, OmniRobot)
    with pytest.raises(ConfigError, match="expected the fields mass, motor_time_constant"):
        omnidirectional(robot)


def test_each_kind_is_refused_where_the_other_is_needed() -> None:
    with pytest.raises(ConfigError, match="drive: expected differential"):
        differential(ALIKE)
    with pytest.raises(ConfigError, match="drive: expected omni, got differential"):
        omnidirectional(PIONEER)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"limits": {"v_side": -1.0}}, "robot.limits.v_side: expected a number from 0.01"),
    ({"limits": {"shape": "circle"}}, "robot.limits.shape: expected one of ellipse, box"),
    ({"limits": {"v_left": 1.0}}, "unknown v_left"),
    ({"grip": 1.0}, "robot.grip: expected at least 5"),
    ({"wheel_radius": 0.1}, "unknown wheel_radius"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_wrong_fields_are_named(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    sections = yaml.safe_load(FILES[0].read_text(encoding="utf-8"))
    for name, value in changes.items():
        if isinstance(value, dict):
            sections["robot"][name].update(value)
        else:
            sections["robot"][name] = value
    with pytest.raises(ConfigError, match=re.escape(message)):
        loaded(sections, tmp_path)


def test_digests_differ_with_the_limits() -> None:
    digests = {robot.digest() for robot in (*ROBOTS, PIONEER)}
    slower = dataclasses.replace(ALIKE, limits=dataclasses.replace(ALIKE.limits, v_side=1.0))
    digests.add(slower.digest())
    assert len(digests) == 4
    assert dataclasses.replace(ALIKE, name="other").digest() == ALIKE.digest()


def test_it_controls_three_axes() -> None:
    axes = {axis.name: axis for axis in UNLIKE.axes}
    assert list(axes) == ["vx", "vy", "w"]
    assert (axes["vx"].limit, axes["vy"].limit) == (1.2, 0.9)
    assert UNLIKE.moves_sideways
    assert UNLIKE.greatest_turn_rate == UNLIKE.limits.w


def test_route_times_grow_with_length_and_turns() -> None:
    nothing = np.zeros(1)

    def time(length: float, turn: float, bends: float = 0.0) -> float:
        turns = (nothing, nothing + bends, nothing + turn)
        return float(UNLIKE.route_time(nothing + length, turns, nothing, nothing)[0])

    assert time(1.0, 0.0) < time(2.0, 0.0)
    assert time(6.0, 0.0) == time(6.0, 1.0)  # it turns while it drives
    assert time(0.0, 0.5) < time(0.0, 1.0)
    assert time(6.0, 0.0) < time(6.0, 0.0, bends=1.0)
