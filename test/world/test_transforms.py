"""Transforms of tf: chains of frames, interpolation, clock resets."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ator_ros.geometry import Pose, quaternion_from_yaw, yaw_from_quaternion
from ator_ros.world.transforms import HERE, Placement, Transforms


def planar(x: float, y: float, yaw: float = 0.0) -> Placement:
    return Placement((x, y, 0.0), quaternion_from_yaw(yaw))


def pose_of(placement: Placement) -> Pose:
    return Pose(*placement.origin[:2], yaw_from_quaternion(*placement.turn))


def same(one: Placement, other: Placement) -> bool:
    near = abs(sum(a * b for a, b in zip(one.turn, other.turn, strict=True)))
    return math.dist(one.origin, other.origin) < 1e-9 and near > 1.0 - 1e-9


def robot_in_map() -> Transforms:
    """Return a tree: map, odom, base_link, camera (looking ahead, its z axis forward), parcel."""
    known = Transforms()
    known.add("map", "odom", 0.0, planar(1.0, 0.0, math.pi / 2.0))
    known.add(
        "base_link", "camera", 0.0, Placement((0.2, 0.0, 0.5), (-0.5, 0.5, -0.5, 0.5)), fixed=True
    )
    for tick in range(21):
        known.add("odom", "base_link", 0.05 * tick, planar(0.1 * tick, 0.0))
    return known


def test_a_frame_is_found_along_a_chain_at_the_latest_common_time() -> None:
    known = robot_in_map()
    time, placement = known.latest("map", "base_link") or (1.0, HERE)
    assert (time, pose_of(placement)) == (0.0, pytest.approx(Pose(1.0, 0.0, math.pi / 2.0)))
    known.add("map", "odom", 2.0, planar(1.0, 0.0, math.pi / 2.0))  # dated ahead, as by AMCL
    time, placement = known.latest("map", "base_link") or (0.0, HERE)
    assert time == pytest.approx(1.0)
    assert pose_of(placement) == pytest.approx(Pose(1.0, 2.0, math.pi / 2.0))
    # 3 m ahead, 0.5 m right
    known.add("camera", "parcel", 0.975, Placement((0.5, 0.2, 3.0), HERE.turn))
    time, placement = known.latest("odom", "parcel") or (0.0, HERE)
    assert time == 0.975
    assert placement.origin == pytest.approx((1.95 + 0.2 + 3.0, -0.5, 0.3))
    _, back = known.latest("parcel", "odom") or (0.0, HERE)
    assert same(back.compose(placement), HERE)


def test_unconnected_frames_or_times_give_no_transform() -> None:
    known = robot_in_map()
    assert known.latest("map", "attic") is None
    assert known.latest("attic", "base_link") is None
    known.add("hall", "map", -5.0, HERE)  # older than all transforms of the robot
    assert known.latest("hall", "base_link") is None
    known.add("a", "b", 0.0, HERE)
    known.add("b", "a", 0.0, HERE)
    assert known.latest("map", "a") is None


def test_a_clock_reset_and_a_new_parent_clear_the_buffer() -> None:
    known = robot_in_map()
    known.add("odom", "base_link", 0.5, planar(9.0, 0.0))
    assert known.latest("odom", "base_link") == (0.5, planar(9.0, 0.0))
    known.add("odom", "base_link", 0.5, planar(8.0, 0.0))
    assert known.latest("odom", "base_link") == (0.5, planar(8.0, 0.0))
    known.add("lift", "base_link", 0.6, planar(0.0, 0.0))
    assert known.latest("odom", "base_link") is None


def test_two_senders_of_one_frame_are_found_on_the_way_to_it() -> None:
    known = robot_in_map()
    assert known.second_sender("map", "camera") is None
    for tick in range(40):  # localization on cells of 5 cm
        known.add("map", "odom", 1.0 + 0.025 * tick, planar(0.05 * (tick % 2), 0.0))
    assert known.second_sender("map", "camera") is None
    for number, distance in enumerate((0.05, 0.4), 2):
        for tick in range(40):
            x = 2.0 + distance * (tick % 2)
            known.add("odom", "base_link", number + 0.025 * tick, planar(x, 0.0))
        found = ("odom", "base_link", f"{distance:.2f} m")
        assert known.second_sender("map", "camera") == found
    assert known.second_sender("map", "odom") is None


def test_two_senders_that_differ_in_heading_only_are_found() -> None:
    known = robot_in_map()
    for tick in range(40):
        time = 1.0 + 0.025 * tick
        known.add("odom", "base_link", time, planar(2.0, 0.0, 3.0 * time + 0.35 * (tick % 2)))
    assert known.second_sender("map", "base_link") == ("odom", "base_link", "0.35 rad")


def test_a_robot_that_spins_has_one_sender() -> None:
    known = robot_in_map()
    for tick in range(200):
        time = 1.0 + 0.05 * tick
        known.add("odom", "base_link", time, planar(2.0, 0.0, 3.0 * time))
        assert known.second_sender("map", "base_link") is None


def test_a_frame_whose_parent_alternates_is_found() -> None:
    known = robot_in_map()
    for tick in range(5):
        time = 1.0 + 0.05 * tick
        known.add("odom", "base_link", time, planar(2.0, 0.0))
        known.add("map", "base_link", time + 0.02, planar(2.3, 0.0))
        known.add("map", "odom", time + 0.02, planar(0.0, 0.0))
    assert known.second_parent("map", "base_link") == ("base_link", "map", "odom")
    assert known.second_parent("map", "odom") is None
    for tick in range(40):  # the other sender has ended
        known.add("odom", "base_link", 2.0 + 0.05 * tick, planar(2.0, 0.0))
    assert known.second_parent("map", "base_link") is None


def test_a_second_parent_may_be_unconnected() -> None:
    known = robot_in_map()
    for tick in range(5):
        known.add("odom", "base_link", 1.0 + 0.05 * tick, planar(2.0, 0.0))
        known.add("odom_combined", "base_link", 1.02 + 0.05 * tick, planar(2.0, 0.0))
    assert known.latest("map", "base_link") is None
    assert known.second_parent("map", "base_link") == ("base_link", "odom", "odom_combined")


PART = st.floats(-1.0, 1.0)
PLACEMENTS = st.builds(
    lambda x, y, z, turn: Placement((x, y, z), tuple(part / math.hypot(*turn) for part in turn)),  # type: ignore[arg-type]
    PART,
    PART,
    PART,
    st.tuples(PART, PART, PART, PART).filter(lambda turn: math.hypot(*turn) > 0.1),
)


@settings(max_examples=40)
@given(PLACEMENTS, PLACEMENTS, PLACEMENTS)
def test_placements_form_a_group(one: Placement, two: Placement, three: Placement) -> None:
    assert same(one.compose(two.compose(three)), one.compose(two).compose(three))
    assert same(one.compose(one.inverse()), HERE)
    assert same(one.inverse().compose(one), HERE)
    assert same(one.compose(HERE), one)


@settings(max_examples=30)
@given(PLACEMENTS, PLACEMENTS, st.floats(0.0, 1.0))
def test_interpolation_moves_evenly(one: Placement, two: Placement, share: float) -> None:
    found = one.between(two, share)
    assert same(one.between(two, 0.0), one)
    assert same(one.between(two, 1.0), two)
    whole = math.dist(one.origin, two.origin)
    assert math.dist(one.origin, found.origin) == pytest.approx(share * whole, abs=1e-9)
    assert same(found, two.between(one, 1.0 - share)) or whole == 0.0 or _opposite(one, two)


def _opposite(one: Placement, two: Placement) -> bool:
    """Return whether the way between two turns is ambiguous."""
    return abs(sum(a * b for a, b in zip(one.turn, two.turn, strict=True))) < 1e-3


def test_a_placement_between_two_times_is_interpolated() -> None:
    known = Transforms()
    for time, x, yaw in ((1.0, 0.0, 0.0), (2.0, 4.0, 1.0), (3.0, 8.0, 1.0)):
        known.add("odom", "base_link", time, planar(x, 0.0, yaw))
    for time, x, yaw in ((1.25, 1.0, 0.25), (2.0, 4.0, 1.0), (2.5, 6.0, 1.0), (1.0, 0.0, 0.0)):
        known.add("base_link", "camera", time, HERE)
        found = known.latest("odom", "camera")
        assert found is not None
        assert found[0] == time
        assert pose_of(found[1]) == pytest.approx(Pose(x, 0.0, yaw))
        known = Transforms() if time == 1.0 else known
    known.add("odom", "base_link", 1.0, HERE)
    known.add("base_link", "camera", 0.9, HERE)
    assert known.latest("odom", "camera") is None


def test_fixed_frames_are_known_at_all_times() -> None:
    known = Transforms()
    known.add("base_link", "camera", 7.0, planar(1.0, 0.0), fixed=True)
    known.add("base_link", "camera", 3.0, planar(2.0, 0.0), fixed=True)
    assert known.latest("base_link", "camera") == (0.0, planar(2.0, 0.0))
    assert known.frames == ["base_link", "camera"]
    known.add("odom", "base_link", 5.0, planar(1.0, 1.0))
    assert known.latest("base_link", "camera") == (5.0, planar(2.0, 0.0))
    time, placement = known.latest("odom", "camera") or (0.0, HERE)
    assert time == 5.0
    assert placement.origin == pytest.approx((3.0, 1.0, 0.0))


def test_the_present_is_that_of_frames_that_moved_within_two_seconds() -> None:
    known = Transforms()
    assert known.present == 0.0
    known.add("odom", "base_link", 10.0, HERE)
    for time, present in ((7.9, 10.0), (8.1, 8.1)):
        known.add("hall", "door", time, HERE)
        assert known.present == present


def test_odometry_is_preferred_where_it_is_an_ancestor() -> None:
    known = robot_in_map()
    time, placement = known.latest_in_odometry("map", "base_link") or (0.0, HERE)
    assert (time, placement.origin) == (1.0, pytest.approx((2.0, 0.0, 0.0)))
    time, placement = known.latest_in_odometry("map", "odom") or (1.0, HERE)
    assert placement == HERE
    known = Transforms()
    known.add("map", "robot1/odom", 1.0, planar(5.0, 0.0))
    known.add("robot1/odom", "robot1/base_link", 1.0, planar(1.0, 0.0))
    found = known.latest_in_odometry("map", "robot1/base_link")
    assert found == (1.0, planar(1.0, 0.0))
    known = Transforms()
    known.add("map", "my_odom", 1.0, planar(5.0, 0.0))
    known.add("my_odom", "base_link", 1.0, planar(1.0, 0.0))
    time, placement = known.latest_in_odometry("map", "base_link") or (0.0, HERE)
    assert placement.origin == pytest.approx((6.0, 0.0, 0.0))


@pytest.mark.parametrize(("frame", "is_found"), [("odom", True), ("map", False)])
def test_small_jumps_count_in_odometry_only(frame: str, is_found: bool) -> None:
    known = Transforms()
    for tick in range(40):
        known.add(frame, "base_link", 0.025 * tick, planar(0.05 * (tick % 2), 0.0))
    assert (known.second_sender(frame, "base_link") is not None) is is_found


@pytest.mark.parametrize(("changes", "is_found"), [(7, False), (8, True)])
def test_eight_changes_back_are_needed(changes: int, is_found: bool) -> None:
    known = Transforms()
    for change in range(changes + 1):
        known.add("odom" if change % 2 else "map", "base_link", 0.5 * change, HERE)
    assert (known.second_parent("odom", "base_link") is not None) is is_found


@pytest.mark.parametrize(("period", "is_found"), [(1.4, True), (1.6, False)])
def test_changes_within_a_second_and_a_half_count(period: float, is_found: bool) -> None:
    known = Transforms()
    for change in range(20):
        known.add("odom" if change % 2 else "map", "base_link", period * change, HERE)
    assert (known.second_parent("odom", "base_link") is not None) is is_found


def test_three_parents_in_turn_are_no_alternation() -> None:
    known = Transforms()
    for change in range(30):
        known.add(("map", "odom", "lift")[change % 3], "base_link", 0.1 * change, HERE)
    assert known.second_parent("lift", "base_link") is None
