"""Descriptions that no body can have are refused, with what was expected and what came."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import pytest
from robots import loaded

from ator_ros.robot.description import ConfigError, load_robot

ROBOT = load_robot()


@pytest.mark.parametrize(
    ("build", "message"),
    [
        ({"wheel_mass": 4.5}, r"own\.yaml: robot\.build\.wheel_mass: expected less than 4\.5, got 4\.5$"),
        (
            {"mass_behind": 0.3},
            r"own\.yaml: robot\.build\.mass_behind: expected less than 0\.24, .* got 0\.3$",
        ),
        (
            {"caster_behind": 0.25},
            r"own\.yaml: robot\.build\.caster_behind: expected at most 0\.24, .* got 0\.25$",
        ),
        ({"mass_behind": "far"}, r"own\.yaml: robot\.build\.mass_behind: expected .*; got 'far'$"),
        ({"wheel_mass": -1.0}, r"own\.yaml: robot\.build\.wheel_mass: expected .*; got -1\.0$"),
        ({"weight": 1.0}, r"own\.yaml: robot\.build.*weight"),
    ],
)
def test_a_build_that_no_body_has_is_refused(build: dict[str, Any], message: str, tmp_path: Path) -> None:
    data = ROBOT.sections()
    data["robot"]["build"] = build
    with pytest.raises(ConfigError, match=message):
        loaded(data, tmp_path)


@pytest.mark.parametrize(
    ("part", "name", "value", "message"),
    [
        ("robot", "track", 0.4, r"own\.yaml: robot\.track: expected at most 0\.38, the width .* got 0\.4$"),
        ("holder", "gap", 0.2, r"robot\.holder\.gap: expected at least 0\.22, the width .* got 0\.2$"),
        ("holder", "gap", 0.45, r"robot\.holder\.gap: expected at most 0\.44, .* got 0\.45$"),
        ("holder", "radius", 0.123, r"robot\.holder\.radius: expected .* \(ball 0\.11\), got 0\.123$"),
        ("robot", "wheel_torque", 0.3, r"robot\.wheel_torque: expected at least 0\.351.*9 kg .* got 0\.3$"),
    ],
)
def test_sizes_that_do_not_fit_each_other_are_refused(
    part: str, name: str, value: float, message: str, tmp_path: Path
) -> None:
    data = ROBOT.sections()
    (data["robot"] if part == "robot" else data["robot"]["holder"])[name] = value
    with pytest.raises(ConfigError, match=message):
        loaded(data, tmp_path)


@pytest.mark.parametrize("length", [0.015, 0.033, 0.047])
def test_a_gap_that_is_asked_for_is_accepted(length: float, tmp_path: Path) -> None:
    data = ROBOT.sections()
    data["robot"]["holder"] |= {"length": length, "gap": 0.05}
    with pytest.raises(ConfigError) as refused:
        loaded(data, tmp_path)
    found = re.search(r"expected at least ([\d.]+)", str(refused.value))
    assert found is not None
    data["robot"]["holder"]["gap"] = float(found[1])
    assert loaded(data, tmp_path).holder is not None


def test_short_fingers_need_not_be_as_far_apart_as_a_ball_is_wide() -> None:
    assert ROBOT.holder is not None
    short = dataclasses.replace(ROBOT.holder, length=0.02)
    assert short.held_width == pytest.approx(2.0 * math.sqrt(0.11**2 - 0.09**2))
