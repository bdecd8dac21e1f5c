"""Derived quantities and predictions of single situations, worked out by hand."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from experience_rows import synthetic_experience

from ator_ros.bases.description import load_robot
from ator_ros.bases.direct import DIRECT_VARIABLES
from ator_ros.performance.derived import NEAR, Geometry, from_hold, wrapped
from ator_ros.performance.features import GENERAL, names_of, variables
from ator_ros.performance.model import UNOBSERVED, AtGoal, PerformanceModel
from ator_ros.performance.training import (
    digest,
    direct_of,
    examples_of,
    observed_arrival,
    start_ranges,
    train,
    without_errors,
)

ROBOT = load_robot()


def direct(**values: Any) -> dict[str, Any]:
    return {**dict.fromkeys(DIRECT_VARIABLES, 0.0), **values}


def value(name: str, **values: Any) -> float:
    return float(GENERAL[name].compute(Geometry(direct(**values), ROBOT))[0])


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
def test_angles_are_wrapped(turns: int) -> None:
    for angle in (-math.pi, -1.0, 0.0, 3.0):
        assert wrapped(angle + 2.0 * math.pi * turns) == pytest.approx(angle)
    assert wrapped(math.pi) == -math.pi


def test_angles_to_and_at_the_destination() -> None:
    geometry = Geometry(direct(x=1.0, y=1.0, yaw=0.3, xg=1.0, yg=3.0, yawg=-2.0), ROBOT)
    assert geometry.dist == pytest.approx([2.0])
    assert geometry.to_dest == pytest.approx([math.pi / 2.0 - 0.3])
    assert geometry.at_dest == pytest.approx([wrapped(-2.0 - math.pi / 2.0)])


def test_a_held_object_is_ahead_of_the_axle() -> None:
    held = {"xg": 2.0, "yg": 1.0, "yawg": math.pi / 2.0}
    assert value("dx", **held, hold=1.0) == pytest.approx(2.0)
    assert value("dy", **held, hold=1.0) == pytest.approx(1.0 - ROBOT.hold)
    assert value("dy", **held, hold=0.0) == pytest.approx(1.0)
    distance, bearing = from_hold(Geometry(direct(yaw=math.pi / 2.0, xg=0.0, yg=2.0), ROBOT))
    assert distance == pytest.approx([2.0 - ROBOT.hold])
    assert bearing == pytest.approx([math.pi / 2.0])


def test_turns_are_signed_by_the_side_of_the_first_turn() -> None:
    left = {"xg": 2.0, "yg": 1.0, "yawg": 1.2, "w": 0.4}
    right = {"xg": 2.0, "yg": -1.0, "yawg": -1.2, "w": -0.4}
    bearing = math.atan2(1.0, 2.0)
    for side in (left, right):
        assert value("angle_at_dest_by_turn", **side) == pytest.approx(1.2 - bearing)
        assert value("w_by_turn", **side) == pytest.approx(0.4)
    assert value("angle_between", yaw=3.0, yawg=-3.0) == pytest.approx(2.0 * math.pi - 6.0)


def test_near_the_goal_the_heading_there_counts() -> None:
    assert value("angle_to_dest", xg=-0.01, yawg=1.0) == pytest.approx(1.0, abs=0.05)
    assert value("angle_to_dest", xg=-2.0 * NEAR, yawg=1.0) == pytest.approx(math.pi)


def test_at_the_goal_a_robot_turns_on_the_spot() -> None:
    limits = ROBOT.limits
    least = 1.5 / limits.w
    assert least < value("path_time", yawg=1.5) < least + 2.0 * limits.w / limits.aw
    assert value("path_turn", yawg=-1.5) == pytest.approx(1.5)
    # with an object in front, only a little
    held = {"xg": ROBOT.hold * math.cos(0.05), "yg": ROBOT.hold * math.sin(0.05), "hold": 1.0}
    assert value("path_turn", **held, yawg=0.05) == pytest.approx(0.05)


def test_paths_take_at_least_their_distance_and_longer_with_rotation() -> None:
    limits = ROBOT.limits
    straight = value("path_time", xg=3.0)
    ramps = limits.v / limits.a + limits.v / limits.brake
    assert straight == pytest.approx(3.0 / limits.v + 0.5 * ramps, rel=0.02)
    assert value("path_time", xg=3.0, w=1.0) > straight
    assert value("path_time", xg=3.0, speedg=0.5) < straight
    assert value("path_time", xg=3.0, v=0.5) < straight


def test_quantities_are_computed_once_and_selected_by_number() -> None:
    geometry = Geometry(direct(xg=1.0, yg=1.0), ROBOT)
    calls: list[Geometry] = []

    def compute(given: Geometry) -> int:
        calls.append(given)
        return 7

    assert [geometry.once(compute) for _ in range(3)] == [7, 7, 7]
    assert calls == [geometry]
    path_time, dist = GENERAL["path_time"], GENERAL["dist"]
    assert path_time.row is not None
    assert dist.row is not None
    selected = geometry.selected([path_time.row, dist.row])
    assert selected[0] == path_time.compute(geometry)
    assert selected[1] == pytest.approx(math.sqrt(2.0))


def test_features_name_their_variables() -> None:
    assert variables("x y xg") == {"x", "y", "xg"}
    assert names_of([GENERAL["dx"], GENERAL["v"]]) == ("dx", "v")


ROWS = synthetic_experience("goToPose", episodes=120)


@pytest.fixture(scope="module")
def model() -> PerformanceModel:
    return train("goToPose", ROWS, ROBOT)


def test_at_the_goal_the_observed_duration_is_predicted(model: PerformanceModel) -> None:
    known = dataclasses.replace(model, at_goal=AtGoal(0.1, 0.2, 0.7, 0.3))
    situations = direct(
        x=np.array([1.0, 1.0, 1.2, 1.0, 1.0]),
        xg=1.0,
        yawg=np.array([0.1, -0.1, 0.1, 0.5, 0.1]),
        v=np.array([0.0, 0.0, 0.0, 0.0, 0.5]),
    )
    found = known.predict(situations, ("duration", "spread"))
    plain = dataclasses.replace(model, at_goal=None).predict(situations, ("spread",))
    assert found.duration is not None
    assert plain.duration is not None
    assert found.spread is not None
    assert plain.spread is not None
    assert found.duration[:2].tolist() == [0.7, 0.7]
    assert found.spread[:2].tolist() == [0.3, 0.3]
    assert (found.duration[2:] == plain.duration[2:]).all()
    assert (found.spread[2:] == plain.spread[2:]).all()
    assert model.at_goal == UNOBSERVED


def test_measures_are_predicted_on_request_only(model: PerformanceModel) -> None:
    situation = direct(xg=2.0)
    found = model.predict(situation)
    assert found.duration is not None
    assert found.success is found.accuracy is found.heading is found.error_of_sum is None
    every = model.predict(situation, ("success", "accuracy", "heading"))
    assert every.duration is every.spread is None
    assert every.success is not None
    assert 0.0 <= every.success[0] <= 1.0
    assert every.accuracy == pytest.approx([0.02], abs=0.02)
    assert every.heading == pytest.approx([0.02], abs=0.001)
    without = dataclasses.replace(model, trees={"duration": model.trees["duration"]})
    assert without.predict(situation, ("success",)).success is None


def test_errors_of_sums_are_those_of_the_process(model: PerformanceModel) -> None:
    situations = direct(xg=np.array([2.0, 2.5]))
    assert model.errors is not None
    names = model.errors.features
    table = np.column_stack(
        [GENERAL[name].compute(Geometry(situations, ROBOT, model.driving)) for name in names]
    )
    signs = np.array([1.0, -1.0])
    found = model.predict(situations, signs=signs).error_of_sum
    assert found == pytest.approx(model.errors.of_sum(table, signs))
    unknown = dataclasses.replace(model, errors=None).predict(situations, signs=signs)
    assert unknown.error_of_sum == (0.0, math.inf)


def test_the_experience_is_that_of_the_starts(model: PerformanceModel) -> None:
    ranges = start_ranges(ROWS, ROBOT)
    assert ranges["speedg"] == [0.0, 0.0]
    dist = np.hypot(ROWS["xg"] - ROWS["x"], ROWS["yg"] - ROWS["y"])
    assert ranges["way"] == pytest.approx([dist.min(), dist.max()])
    assert 0.0 <= ranges["turn"][0] < ranges["turn"][1] <= math.pi
    there = dataclasses.replace(model, metadata={"training": {"starts": ranges}})
    assert there.experience["way"] == pytest.approx((dist.min(), dist.max()))
    assert dataclasses.replace(model, metadata={}).experience == {}


def test_a_digest_changes_with_what_is_learned_from() -> None:
    before = digest(ROWS)
    assert len(before) == 16
    assert digest(ROWS.copy()) == before
    assert digest(ROWS.assign(reason="other")) == before
    for name in ("x", "yawg", "time_to_go"):
        assert digest(ROWS.assign(**{name: ROWS[name] + 0.1})) != before
    assert digest(ROWS.iloc[1:]) != before


def test_arrivals_are_the_median_errors_of_drives_between_stands() -> None:
    rows = ROWS.assign(position_error=0.03, heading_error=0.04)
    rows.loc[0, "position_error"] = 5.0
    found = observed_arrival(rows, ROBOT)
    assert found is not None
    assert (found.dist, found.angle) == (0.03, 0.04)
    unknown = observed_arrival(rows.assign(heading_error=np.nan), ROBOT)
    assert unknown is not None
    assert (unknown.dist, unknown.angle) == (0.03, 0.0)
    assert observed_arrival(rows.assign(speedg=0.4), ROBOT) is None
    assert observed_arrival(rows.assign(v=0.4), ROBOT) is None
    # hardly any turn at the goal
    straight = rows.assign(yawg=np.arctan2(rows["yg"] - rows["y"], rows["xg"] - rows["x"]))
    found = observed_arrival(straight, ROBOT)
    assert found is not None
    assert found.angle == 0.0


def test_missing_errors_are_remarked() -> None:
    rows = ROWS.assign(success=True)
    assert without_errors("go", rows) == []
    rows.loc[:2, "heading_error"] = np.nan
    (remark,) = without_errors("go", rows)
    assert remark == "go: heading_error: 3 of 120 episodes have none and are left out"
    assert without_errors("go", rows.assign(heading_error=np.nan)) == []


def test_examples_are_those_whose_measure_is_known() -> None:
    rows = ROWS.copy()
    rows.loc[:3, "success"] = False
    rows.loc[4:6, "heading_error"] = np.nan
    rows.loc[7:, "success"] = True
    found = examples_of(rows, ROBOT, [GENERAL["dist"]], None)
    assert found["success"].rows.tolist() == list(range(120))
    assert found["success"].values[:4].tolist() == [0.0] * 4
    succeeded = np.flatnonzero(rows["success"]).tolist()
    assert found["duration"].rows.tolist() == succeeded
    assert found["heading"].rows.tolist() == [row for row in succeeded if row not in (4, 5, 6)]
    dist = np.hypot(rows["xg"] - rows["x"], rows["yg"] - rows["y"])
    table = found["heading"].table["dist"]
    assert table.to_numpy() == pytest.approx(dist[found["heading"].rows])
    assert table.index.tolist() == list(range(len(table)))
    assert found["heading"].parts is None
    assert found["duration"].parts is not None
    assert found["duration"].parts.shape == (len(succeeded), 3)


def test_direct_variables_include_declared_ones_with_values() -> None:
    rows = ROWS.assign(loadg=np.nan)
    assert set(direct_of(rows)) == set(DIRECT_VARIABLES)
    rows.loc[0, "loadg"] = 2.0
    assert "loadg" in direct_of(rows)
