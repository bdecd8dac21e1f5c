"""Features: their values, variables and invariances."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ator_ros.bases.description import Robot, load_robot
from ator_ros.bases.differential.driving import plain_driving
from ator_ros.bases.direct import DIRECT_VARIABLES
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import PAPER_3, PAPER_11, PATHS, Feature, base_features, names_of
from ator_ros.performance.features import feature_table as table_of_features

ROBOT = load_robot()
FEATURES = SOCCER.known_features
NAMES = tuple(FEATURES)
Direct = dict[str, FloatArray]


DRIVING = dataclasses.replace(plain_driving(ROBOT.limits), backward_above=2.0)


def feature_table(direct: Mapping[str, Any], robot: Robot, names: Sequence[str]) -> FloatArray:
    return table_of_features(direct, robot, [FEATURES[name] for name in names], DRIVING)


PLACES, DIRECTIONS = (
    {"x", "y", "xg", "yg"},
    {"yaw", "yawg", "dx", "dy", "hold_off_axis", "heading_off_axis"},
)
"""Features that change when the world is moved, and those that change when it is turned."""
ODD = {"y", "yaw", "yg", "yawg", "dy"}
"""Features that change sign if the world is mirrored at the x axis; the others are unchanged."""


def situations(seed: int, count: int = 50) -> Direct:
    rng = np.random.default_rng(seed)
    return {
        "x": rng.uniform(-4, 4, count),
        "y": rng.uniform(-3, 3, count),
        "yaw": rng.uniform(-math.pi, math.pi, count),
        "v": rng.uniform(-0.3, 1.0, count),
        "w": rng.uniform(-2, 2, count),
        "xg": rng.uniform(-4, 4, count),
        "yg": rng.uniform(-3, 3, count),
        "yawg": rng.uniform(-math.pi, math.pi, count),
        "speedg": rng.uniform(0, 0.8, count),
        "hold": rng.integers(0, 2, count).astype(float),
        "vy": rng.uniform(-0.5, 0.5, count),
    }


def moved(direct: Direct, dx: float, dy: float) -> Direct:
    return {
        **direct,
        "x": direct["x"] + dx,
        "xg": direct["xg"] + dx,
        "y": direct["y"] + dy,
        "yg": direct["yg"] + dy,
    }


def turned(direct: Direct, angle: float) -> Direct:
    c, s = math.cos(angle), math.sin(angle)
    d = direct
    return {
        **d,
        "x": c * d["x"] - s * d["y"],
        "y": s * d["x"] + c * d["y"],
        "xg": c * d["xg"] - s * d["yg"],
        "yg": s * d["xg"] + c * d["yg"],
        "yaw": d["yaw"] + angle,
        "yawg": d["yawg"] + angle,
    }


def mirrored(direct: Direct) -> Direct:
    return {**direct, **{name: -direct[name] for name in ("y", "yaw", "w", "vy", "yg", "yawg")}}


def table(direct: Direct) -> dict[str, FloatArray]:
    return dict(zip(NAMES, feature_table(direct, ROBOT, NAMES).T, strict=True))


def same(one: FloatArray, two: FloatArray, feature: Feature) -> bool:
    difference = np.abs(one - two)
    if feature.unit == "rad" and feature not in PATHS:
        difference = np.minimum(difference, np.abs(2 * math.pi - difference))
    if feature in PATHS:
        # Rounding decides between neighboring entries of the tables, and between motions of one
        # duration.
        return bool(np.mean(difference < 0.02) >= 0.94)
    return bool(np.all(difference < 1e-9))


@settings(deadline=None)
@given(dx=st.floats(-3, 3), dy=st.floats(-3, 3), angle=st.floats(-3, 3), seed=st.integers(0, 1000))
def test_features_have_their_declared_invariances(
    dx: float, dy: float, angle: float, seed: int
) -> None:
    direct = situations(seed)
    before, mirror = table(direct), table(mirrored(direct))
    shifted, rotated = table(moved(direct, dx, dy)), table(turned(direct, angle))
    for name, feature in FEATURES.items():
        assert name in PLACES or same(before[name], shifted[name], feature), name
        assert name in (*PLACES, *DIRECTIONS) or same(before[name], rotated[name], feature), name
        assert same((-1.0 if name in ODD else 1.0) * before[name], mirror[name], feature), name


@pytest.mark.parametrize("name", NAMES)
def test_features_depend_on_exactly_their_declared_variables(name: str) -> None:
    direct = situations(1, 400)
    before = feature_table(direct, ROBOT, [name])
    for variable in DIRECT_VARIABLES:
        other = direct.get(variable, 0.0) * 0.9 + 0.03
        if variable == "hold":
            other = 1.0 - direct["hold"]
        after = feature_table({**direct, variable: other}, ROBOT, [name])
        assert (variable in FEATURES[name].derives) == bool(np.any(before != after)), variable


def test_paper_features_of_a_known_situation() -> None:
    direct = {
        **dict.fromkeys(DIRECT_VARIABLES, 0.0),
        "x": 1.0,
        "xg": 1.0,
        "yg": 2.0,
        "yawg": math.pi / 2,
    }
    values = dict(
        zip(names_of(PAPER_11), feature_table(direct, ROBOT, names_of(PAPER_11))[0], strict=True)
    )
    assert names_of(PAPER_3) == ("dist", "angle_to_dest", "angle_at_dest")
    assert values["dist"] == pytest.approx(2.0)
    assert values["angle_to_dest"] == pytest.approx(math.pi / 2)
    assert values["angle_at_dest"] == pytest.approx(0.0)
    assert (values["dx"], values["dy"]) == pytest.approx((0.0, 2.0))


def test_a_drive_backward_turns_from_and_to_the_opposite_headings() -> None:
    direct = {
        **dict.fromkeys(DIRECT_VARIABLES, 0.0),
        "xg": 2.0,
        "yaw": np.array([1.9, 2.5]),
        "yawg": 3.0,
    }
    features = base_features(ROBOT.driving)
    forward, backward = table_of_features(direct, ROBOT, features, DRIVING)
    assert forward == pytest.approx([1.9, 3.0, 0.0, 0.0])
    assert backward == pytest.approx([math.pi - 2.5, math.pi - 3.0, 1.0, 2.0])
