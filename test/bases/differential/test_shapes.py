"""The fastest of several shapes of paths is that of all paths, and has their symmetries."""

import math

import numpy as np
import pytest
from robots import PIONEER

from ator_ros.bases.differential.durations import drive_time, rates_of, turn_time
from ator_ros.bases.differential.manoeuvre import Side
from ator_ros.bases.differential.paths import entries_of, exits_of, find_paths
from ator_ros.bases.differential.shapes import (
    SPEED_STEP,
    Rules,
    Shape,
    ShapeSet,
    drawn_ends,
    fastest_paths,
    needed_shapes,
    shape_set,
)
from ator_ros.geometry import FloatArray, Pose

LIMITS = PIONEER.limits
RATES = rates_of(LIMITS)
HOLD = 0.3
STILL = Shape(0.0, LIMITS.w, 0.0, LIMITS.w, share=math.nan)
"""Turn, drive, turn at constant speed, without a run."""


def one(shape: Shape, **rules: float | bool) -> ShapeSet:
    return shape_set([[shape]], Rules(RATES, **rules))  # type: ignore[arg-type]


def ends(count: int, *, speed: float = 0.0, seed: int = 1) -> FloatArray:
    rng = np.random.default_rng(seed)
    drawn = np.empty((5, count))
    drawn[:2] = rng.uniform(-3.0, 3.0, (2, count))
    drawn[2] = rng.uniform(-math.pi, math.pi, count)
    drawn[3:] = speed
    return drawn


def times(shapes: ShapeSet, drawn: FloatArray, hold: float = HOLD) -> FloatArray:
    return fastest_paths(drawn, shapes, hold)[0]


@pytest.mark.parametrize(("change", "speed"), [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.4)])
def test_times_are_those_of_the_search_for_all_paths(change: float, speed: float) -> None:
    rate = 0.8 * LIMITS.w
    shape = Shape(change, rate, -change, LIMITS.w, share=math.nan)
    drawn = ends(60, speed=speed)
    found, turned = fastest_paths(drawn, one(shape), HOLD)
    entries = entries_of([Side(0.0, speed, speed, change, rate)], LIMITS)
    exits = exits_of([Side(0.0, speed, speed, -change, LIMITS.w)], LIMITS)
    off = []
    for time, angle, (x, y, yaw, *_) in zip(found, turned, drawn.T, strict=True):
        paths = find_paths(Pose(0.0, 0.0, 0.0), Pose(x, y, yaw), entries, exits, LIMITS)
        # a shape goes forward
        paths = paths[(paths["drive"] > 0.0) & (np.abs(paths["first"]) < 1.5 * math.pi)]
        best = int(np.argmin(paths["time"])) if len(paths) else -1
        if best < 0:
            continue
        off.append(time / paths["time"][best] - 1.0)
        if abs(off[-1]) < 1e-3:
            assert angle == pytest.approx(
                abs(paths["first"][best]) + abs(paths["last"][best]), abs=0.05
            )
    assert len(off) > 30
    assert abs(np.median(off)) < 1e-3
    assert np.percentile(np.abs(off), 80) < 0.02


def test_a_straight_drive_takes_the_time_of_the_drive() -> None:
    distances = np.array([0.5, 1.0, 3.0])
    drawn = np.zeros((5, 3))
    drawn[0] = distances
    found, turned = fastest_paths(drawn, one(STILL), HOLD)
    assert found == pytest.approx(drive_time(distances, np.zeros(3), np.zeros(3), LIMITS), abs=1e-3)
    assert turned == pytest.approx(np.zeros(3), abs=1e-3)


def test_a_goal_aside_is_a_quarter_turn_to_either_side_and_back() -> None:
    drawn = np.zeros((5, 2))
    drawn[1] = 2.0, -2.0
    found, turned = fastest_paths(drawn, one(STILL), HOLD)
    expected = 2.0 * turn_time(math.pi / 2.0, LIMITS.w, LIMITS.aw) + drive_time(
        2.0, 0.0, 0.0, LIMITS
    )
    assert found == pytest.approx([expected, expected], rel=1e-3)
    assert turned == pytest.approx([math.pi, math.pi], rel=1e-3)


@pytest.mark.parametrize("speed", [0.0, 0.3])
@pytest.mark.parametrize("forward", [False, True])
def test_mirrored_ends_take_the_same_time(speed: float, forward: bool) -> None:
    shapes = one(replace_share(STILL, 0.5), forward=forward, run=0.2, passing=0.3)
    drawn = ends(80, speed=speed)
    mirrored = drawn * np.array([[1.0], [-1.0], [-1.0], [1.0], [1.0]])
    assert times(shapes, mirrored) == pytest.approx(times(shapes, drawn), abs=2e-3)


def replace_share(shape: Shape, share: float) -> Shape:
    return shape._replace(share=share)


def test_the_same_pair_takes_the_same_time_wherever_it_is_in_a_call() -> None:
    """Blocks, groups and their order must not matter."""
    group = [STILL, STILL._replace(first_change=0.3), STILL._replace(last_change=0.3)]
    shapes = shape_set([group, [STILL._replace(first_rate=0.5)]], Rules(RATES))
    drawn = ends(200, speed=0.2)
    together = fastest_paths(drawn, shapes, HOLD)
    single = [fastest_paths(drawn[:, at : at + 1], shapes, HOLD)[:, 0] for at in range(0, 200, 7)]
    assert np.array_equal(together[:, ::7].T, np.array(single))
    backward = fastest_paths(drawn[:, ::-1], shapes, HOLD)[:, ::-1]
    assert np.array_equal(together, backward)


def test_more_shapes_are_never_slower_and_each_group_is_used() -> None:
    slow, fast = STILL._replace(first_rate=0.4, last_rate=0.4), STILL
    drawn = ends(100)
    alone = times(one(slow), drawn)
    both = times(shape_set([[slow], [fast]], Rules(RATES)), drawn)
    grouped = times(shape_set([[slow, fast]], Rules(RATES)), drawn)
    assert (both <= alone).all()
    assert both == pytest.approx(np.minimum(alone, times(one(fast), drawn)))
    assert np.array_equal(both, grouped)


def test_a_shape_is_not_for_slower_ends() -> None:
    drawn = ends(30, speed=0.3)
    shapes = one(STILL)
    for bound in ({"least_start": 0.4}, {"least_arrival": 0.4}):
        assert (times(one(STILL._replace(**bound)), drawn) == shapes.missed[0]).all()
        fast = drawn.copy()
        fast[3:] = 0.5
        assert np.array_equal(times(one(STILL._replace(**bound)), fast), times(shapes, fast))


def test_ends_that_no_shape_joins_take_two_half_turns() -> None:
    drawn = ends(5)
    drawn[0] = math.nan
    found, turned = fastest_paths(drawn, one(STILL), HOLD)
    half = turn_time(math.pi, LIMITS.w, LIMITS.aw)
    assert found == pytest.approx([2.0 * half] * 5)
    assert turned == pytest.approx([2.0 * math.pi] * 5)
    whole = fastest_paths(drawn, one(STILL, forward=True), HOLD)
    assert whole[0] == pytest.approx([2.0 * turn_time(math.tau, LIMITS.w, LIMITS.aw)] * 5)


def test_a_backward_shape_is_a_forward_one_seen_backward() -> None:
    drawn = ends(80)
    turned = drawn * np.array([[-1.0], [-1.0], [1.0], [1.0], [1.0]])
    back = one(STILL._replace(direction=-1.0))
    assert times(back, drawn) == pytest.approx(times(one(STILL), turned), rel=1e-6)


def test_a_straight_line_before_the_first_turn_reaches_its_speed() -> None:
    drawn = np.zeros((5, 1))
    drawn[0] = 2.0
    lead = one(STILL._replace(entry=0.4))
    assert times(lead, drawn) == pytest.approx(drive_time(2.0, 0.0, 0.0, LIMITS), rel=1e-3)
    drawn[1] = 2.0
    # At 0.4 m/s it turns by some 45 degrees after the lead, and back before the goal.
    distance = 0.5 * 0.4**2 / LIMITS.a
    assert times(lead, drawn) > distance / 0.4


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_run_ends_on_a_straight_line_at_the_goal(share: float) -> None:
    drawn = ends(40)
    shape = STILL._replace(share=share)
    longer = times(one(shape, run=0.5), drawn)
    entries = entries_of([Side(0.0, 0.0, 0.0, 0.0, LIMITS.w)], LIMITS)
    fastest = min(math.sqrt(2.0 * LIMITS.brake * 0.5), LIMITS.v)
    exits = exits_of([Side(0.5, 0.0, share * fastest, 0.0, LIMITS.w)], LIMITS)
    off = []
    for time, (x, y, yaw, *_) in zip(longer, drawn.T, strict=True):
        paths = find_paths(Pose(0.0, 0.0, 0.0), Pose(x, y, yaw), entries, exits, LIMITS)
        paths = paths[paths["drive"] > 0.0]
        if len(paths):
            off.append(time / paths["time"][0] - 1.0)
    assert abs(np.median(off)) < 2e-3


def test_a_run_as_long_as_needed_brakes_from_a_share_of_the_limit() -> None:
    drawn = np.zeros((5, 1))
    drawn[0] = 3.0
    found = times(one(STILL._replace(share=0.5), run=math.nan), drawn)
    assert found == pytest.approx(drive_time(3.0, 0.0, 0.0, LIMITS), rel=0.5)
    assert found > drive_time(3.0, 0.0, 0.0, LIMITS)


def test_a_robot_that_never_drives_backward_pays_for_what_a_drive_is_too_short() -> None:
    drawn = ends(300)
    drawn[:2] *= np.linspace(0.1, 1.0, 300)
    drawn[4] = 0.6
    plain, forward = one(STILL), one(STILL, forward=True)
    free, bound = times(plain, drawn), times(forward, drawn)
    both = (free < plain.missed[0]) & (bound < forward.missed[0])
    far = both & (np.hypot(*drawn[:2]) > 2.0)
    assert np.mean(bound[far] == free[far]) > 0.9
    # Other robots overshoot and come back, which takes longer than other speeds in the turns.
    assert (bound[both] < free[both] - 0.05).any()
    gaining = 0.6 / LIMITS.a
    assert (bound[both] > gaining).all()


def test_passing_near_the_object_at_the_goal_costs_a_detour() -> None:
    drawn = np.zeros((5, 1))
    drawn[0] = 2.0
    drawn[2] = math.pi  # the object at the goal is in the way
    free = times(one(STILL), drawn)[0]
    passing = times(one(STILL, passing=0.4), drawn)[0]
    assert passing == pytest.approx(free + 7.2 / LIMITS.v * 0.4, rel=1e-2)
    drawn[2] = 0.0  # it is behind the goal
    assert times(one(STILL, passing=0.4), drawn) == pytest.approx(times(one(STILL), drawn))


def test_with_a_free_heading_the_drive_ends_at_the_object() -> None:
    drawn = ends(60)
    found, turned = fastest_paths(drawn, one(STILL, free_heading=True), HOLD)
    x = drawn[0] + HOLD * np.cos(drawn[2])
    y = drawn[1] + HOLD * np.sin(drawn[2])
    angles = np.abs(np.arctan2(y, x))
    expected = turn_time(angles, LIMITS.w, LIMITS.aw)
    expected += drive_time(np.hypot(x, y) - HOLD, np.zeros(60), np.zeros(60), LIMITS)
    far = np.hypot(x, y) > HOLD
    assert found[far] == pytest.approx(expected[far], rel=2e-3)
    assert turned[far] == pytest.approx(angles[far], abs=2e-3)


def test_few_shapes_of_a_grid_are_nearly_as_fast_as_all() -> None:
    changes = (-0.4, -0.2, 0.0, 0.2, 0.4)
    grid = [STILL._replace(first_change=one, last_change=two) for one in changes for two in changes]
    every = shape_set([[shape] for shape in grid], Rules(RATES))
    drawn = drawn_ends(ends(50, speed=0.4), 300, np.random.default_rng(5))
    groups = needed_shapes(every, drawn, hold=HOLD)
    used = [number for group in groups for number in group]
    assert len(set(used)) < len(grid)
    chosen = shape_set([[grid[number] for number in group] for group in groups], Rules(RATES))
    mine, best = times(chosen, drawn), times(every, drawn)
    reached = best < every.missed[0]
    assert np.mean(mine[reached] / best[reached]) < 1.002
    nowhere = drawn.copy()
    nowhere[0] = math.nan
    assert needed_shapes(every, nowhere, hold=HOLD) == [[0]]


def test_drawn_ends_are_like_the_given_ones() -> None:
    like = ends(400, speed=0.0)
    like[3, ::2] = np.linspace(0.2, 0.6, 200)
    drawn = drawn_ends(like, 2000, np.random.default_rng(3))
    assert drawn.shape == (5, 2000)
    distances = np.hypot(*drawn[:2])
    assert distances.max() <= np.hypot(*like[:2]).max() + 1e-9
    assert np.median(distances) < np.median(np.hypot(*like[:2]))
    assert np.mean(drawn[3] == 0.0) == pytest.approx(0.5, abs=0.05)
    assert (drawn[4] == 0.0).all()
    moving = drawn[3][drawn[3] != 0.0]
    assert moving.max() <= 0.6
    directions = np.arctan2(drawn[1], drawn[0])
    assert abs(np.cos(directions).mean()) < 0.05
    assert abs(np.sin(directions).mean()) < 0.05
    assert np.abs(drawn[2]).max() <= math.pi


def test_tables_of_turns_cover_every_speed_within_a_step() -> None:
    shapes = one(STILL)
    speeds = shapes.tables.lowest + SPEED_STEP * np.arange(shapes.tables.speeds)
    assert speeds[0] == pytest.approx(-LIMITS.v)
    assert speeds[-1] == pytest.approx(LIMITS.v, abs=SPEED_STEP)
    forward = one(STILL, forward=True).tables
    assert -SPEED_STEP < forward.lowest <= 0.0
