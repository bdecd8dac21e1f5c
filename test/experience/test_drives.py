"""Drives in odometry and commands, from tables written by hand."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from bags import ROBOT, Messages, Tick

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.drives import CMD_VEL, Reader, drives
from ator_ros.experience.server_drives import ODOM
from ator_ros.experience.table import Episode
from ator_ros.experience.track import Rows, Segment, Track
from ator_ros.geometry import Pose

TICK = 0.05
CONTRADICTS = "poses and velocities contradict each other: the pose was reset, or the robot moved"
Phase = tuple[float, float]
"""Speed (m/s) and how long it is commanded (s)."""


def segment_of(*phases: Phase, silent: Iterable[int] = (), lag: float = 0.0) -> Segment:
    """Return straight drives along x.

    In `silent` phases no commands are sent. The base follows commands `lag` s later.
    """
    segment = Segment()
    moved, time = 0.0, 0.0
    later = round(lag / TICK)
    speeds = [speed for speed, length in phases for _ in range(round(length / TICK))]
    quiet = [
        at in tuple(silent) for at, (_, n) in enumerate(phases) for _ in range(round(n / TICK))
    ]
    for at, (speed, is_quiet) in enumerate(zip(speeds, quiet, strict=True)):
        driven = speeds[at - later] if at >= later else 0.0
        segment.odom.append(time, moved, 0.0, 0.0, driven, 0.0, 0.0)
        if not is_quiet:
            segment.cmd_vel.append(time, speed, 0.0)
        moved += TICK * driven
        time = round(time + TICK, 6)
    return segment


def found(segment: Segment) -> list[Episode | str]:
    return list(drives(segment, ROBOT, SOCCER))


def lengths(segment: Segment) -> list[float]:
    episodes = [each for each in found(segment) if isinstance(each, Episode)]
    return [each.situation.goal.pose.x - each.situation.robot.pose.x for each in episodes]


def test_a_drive_begins_with_a_command_and_ends_at_rest() -> None:
    segment = segment_of((0.0, 1.0), (0.4, 2.0), (0.0, 1.0), lag=0.1)
    (episode,) = found(segment)
    assert isinstance(episode, Episode)
    assert episode.duration == pytest.approx(2.1)
    assert episode.situation.robot.pose.x == 0.0
    assert episode.situation.goal.pose.x == pytest.approx(0.8)
    assert (episode.situation.action, episode.success) == ("goToPose", True)
    assert episode.reason.startswith("recorded")
    assert math.isnan(episode.position_error)
    assert math.isnan(episode.heading_error)
    assert episode.situation.goal.speed == 0.0


@pytest.mark.parametrize(("pause", "count"), [(0.2, 1), (0.3, 2), (1.0, 2)])
def test_a_pause_of_commands_separates_drives(pause: float, count: int) -> None:
    segment = segment_of((0.4, 1.0), (0.0, pause), (0.4, 1.5), (0.0, 1.0))
    expected = [0.4, 0.6] if count == 2 else [1.0]
    assert lengths(segment) == pytest.approx(expected)


@pytest.mark.parametrize(("length", "count"), [(0.4, 0), (0.5, 1)])
def test_drives_of_less_than_half_a_second_do_not_count(length: float, count: int) -> None:
    assert len(found(segment_of((0.0, 1.0), (0.4, length), (0.0, 1.0)))) == count


def test_a_drive_that_does_not_end_is_left_out() -> None:
    assert found(segment_of((0.4, 1.0), (0.0, 1.0), (0.4, 1.0))) != []
    assert lengths(segment_of((0.0, 0.5), (0.4, 1.0))) == []


def test_a_drive_that_ends_without_a_stop_has_no_goal() -> None:
    """The watchdog of the base stopped it; a robot that drove on was not stopped."""
    stopped = segment_of((0.4, 1.0), (0.0, 2.0), (0.4, 1.0), (0.0, 1.0), silent=[1])
    assert lengths(stopped) == pytest.approx([0.4])
    drove_on = segment_of((0.4, 1.0), (0.4, 2.0), (0.4, 1.0), (0.0, 1.0), silent=[1])
    assert lengths(drove_on) == pytest.approx([1.6])
    short = segment_of((0.4, 1.0), (0.0, 0.9), (0.4, 1.0), (0.0, 1.0), silent=[1])
    assert lengths(short) == pytest.approx([0.8])


def test_a_drive_of_more_than_an_hour_is_left_out() -> None:
    segment = Segment()
    for time in np.arange(0.0, 3700.0, 0.5).tolist():
        speed = 0.1 if 1.0 <= time < 3660.0 else 0.0
        segment.odom.append(
            time, 0.1 * min(max(time - 1.0, 0.0), 3659.0), 0.0, 0.0, speed, 0.0, 0.0
        )
        segment.cmd_vel.append(time, speed, 0.0)
    assert found(segment) == ["expected at most 3600 s"]


@pytest.mark.parametrize(("jump", "is_one"), [(0.1, False), (0.6, True)])
def test_a_jump_is_farther_than_four_times_the_robot_drives(jump: float, is_one: bool) -> None:
    """Within a tick the robot of 1 m/s may be described at a quarter of its speed, plus 10 cm."""
    segment = segment_of((0.0, 0.5), (0.4, 1.0), (0.0, 1.0))
    moved = Segment()
    for row in segment.odom.in_order().tolist():
        moved.odom.append(row[0], row[1] + (jump if row[0] > 1.0 else 0.0), *row[2:])
    moved.cmd_vel = segment.cmd_vel
    (episode,) = found(moved)
    assert (episode == "the pose jumps during the drive") == is_one


def test_a_turn_of_the_pose_may_be_a_jump() -> None:
    segment = segment_of((0.0, 0.5), (0.4, 1.0), (0.0, 1.0))
    turned = Segment()
    for row in segment.odom.in_order().tolist():
        turned.odom.append(*row[:3], 2.5 if row[0] > 1.0 else 0.0, *row[4:])
    turned.cmd_vel = segment.cmd_vel
    assert found(turned) == ["the pose jumps during the drive"]


@pytest.mark.parametrize(("resets", "is_one"), [(1, False), (5, True)])
def test_small_resets_of_the_pose_add_up(resets: int, is_one: bool) -> None:
    """One of 29 cm may be a correction of the odometry, but five in 3.6 m are not."""
    segment = segment_of((0.0, 0.5), (0.6, 6.0), (0.0, 1.0))
    reset = Segment(cmd_vel=segment.cmd_vel)
    for time, x, *others in segment.odom.in_order().tolist():
        passed = min(max(int(time - 1.0), 0), resets)
        reset.odom.append(time, x - 0.29 * passed, *others)
    (episode,) = found(reset)
    assert (episode == CONTRADICTS) == is_one


def test_without_odometry_or_commands_there_are_no_drives() -> None:
    whole = segment_of((0.4, 1.0), (0.0, 1.0))
    for part in (Segment(odom=whole.odom), Segment(cmd_vel=whole.cmd_vel), Segment()):
        assert found(part) == []


# States between messages


def test_rows_are_sorted_by_time() -> None:
    rows = Rows(2)
    assert len(rows) == 0
    for time in (1.0, 3.0, 2.0, 2.0):
        rows.append(time, float(len(rows)))
    assert len(rows) == 4
    assert (rows.first, rows.last) == ((1.0, 0.0), (2.0, 3.0))
    assert rows.in_order().tolist() == [[1.0, 0.0], [2.0, 2.0], [2.0, 3.0], [3.0, 1.0]]


def turning() -> Track:
    """Return a robot that turns through pi, and a ball that is seen from 1 s on."""
    segment = Segment()
    for time in np.arange(10.0, 12.01, 0.1).tolist():
        yaw = math.remainder(3.0 + 0.5 * (time - 10.0), math.tau)
        segment.odom.append(time, 2.0, 0.1 * (time - 10.0), yaw, 0.0, 0.5, 0.1)
    for time in (11.0, 12.0):
        segment.objects["ball"].append(time, 5.0 * (time - 11.0), 1.0)
    return Track(segment)


def test_states_are_interpolated() -> None:
    track = turning()
    states = track.states(np.array([10.05, 11.25]))
    yaw = math.remainder(3.625, math.tau)
    assert states[0, :7] == pytest.approx([10.05, 2.0, 0.005, 3.025, 0.0, 0.5, 0.1])
    assert states[1, :7] == pytest.approx([11.25, 2.0, 0.125, yaw, 0.0, 0.5, 0.1])
    assert np.isnan(states[0, 7:]).all()
    assert states[1, 7:] == pytest.approx([1.25, 1.0])
    assert track.world(10.5).objects == {}
    world = track.world(11.5)
    assert (world.objects["ball"].x, world.objects["ball"].y) == pytest.approx((2.5, 1.0))
    assert (world.robot.vx, world.robot.vy, world.robot.w) == pytest.approx((0.0, 0.1, 0.5))


def test_a_track_is_seen_from_another_frame() -> None:
    track = turning()
    odom = Pose(1.0, -2.0, 0.5)
    there = track.seen_from(odom)
    for time in (10.3, 11.7):
        here = track.world(time)
        moved = there.world(time)
        expected = odom.compose(here.robot.pose)
        assert moved.robot.pose[:2] == pytest.approx(expected[:2])
        assert math.remainder(moved.robot.pose.yaw - expected.yaw, math.tau) == pytest.approx(0.0)
        assert moved.robot.w == pytest.approx(here.robot.w)
        for name, ball in here.objects.items():
            place = odom.compose(Pose(ball.x, ball.y, 0.0))
            assert (moved.objects[name].x, moved.objects[name].y) == pytest.approx(place[:2])


def test_samples_are_at_10_hz_and_before_the_end() -> None:
    track = turning()
    samples = track.samples(10.2, 10.9, ["ball"])
    assert samples[:, 0] == pytest.approx(np.arange(0.0, 0.65, 0.1))
    assert samples.shape == (7, 9)
    assert samples[:, 2] == pytest.approx(0.02 + 0.01 * np.arange(7))
    assert track.samples(10.2, 10.9, []).shape == (7, 7)
    assert len(track.samples(10.2, 10.95, [])) == 8


def straight(v: float, reported: float, *, seconds: float, w: float = 0.0) -> Track:
    segment = Segment()
    for time in np.arange(0.0, seconds, TICK).tolist():
        heading = w * time
        x = v * time if w == 0.0 else v / w * math.sin(heading)
        y = 0.0 if w == 0.0 else v / w * (1.0 - math.cos(heading))
        segment.odom.append(time, x, y, heading, reported, w, 0.0)
    return Track(segment)


@pytest.mark.parametrize(
    ("v", "reported", "seconds", "corrected"),
    [
        (0.4, 0.4, 3.0, False),
        (0.4, 0.35, 3.0, False),
        (0.4, 0.0, 3.0, True),
        (0.4, -0.4, 3.0, True),
        (-0.4, 0.4, 3.0, True),
        (0.4, 0.0, 0.9, False),  # too short to decide
        (0.04, 0.0, 3.0, False),  # slower than the noise of poses
    ],
)
def test_the_poses_decide_where_the_twist_contradicts_them(
    v: float, reported: float, seconds: float, corrected: bool
) -> None:
    track = straight(v, reported, seconds=seconds)
    assert track.corrected == ({"twist.linear"} if corrected else set())
    expected = v if corrected else reported
    assert track.odom[2:-2, 4] == pytest.approx(expected, abs=0.01)


def test_a_turn_rate_is_corrected_too() -> None:
    segment = Segment()
    for time in np.arange(0.0, 3.0, TICK).tolist():
        segment.odom.append(time, 0.0, 0.0, math.remainder(0.8 * time, math.tau), 0.0, 0.1, 0.0)
    track = Track(segment)
    assert track.corrected == {"twist.angular"}
    assert track.odom[:, 5] == pytest.approx(0.8, abs=0.01)


def test_speeds_along_an_arc_are_not_corrected() -> None:
    track = straight(0.5, 0.5, seconds=3.0, w=0.7)
    assert track.corrected == set()


def test_a_speed_along_an_arc_is_derived_from_its_poses() -> None:
    track = straight(0.5, 0.0, seconds=3.0, w=2.0)
    assert track.corrected == {"twist.linear"}
    assert track.odom[2:-2, 4] == pytest.approx(0.5, abs=0.01)


def test_a_robot_that_turns_in_place_is_not_at_rest() -> None:
    assert not straight(0.0, 0.0, seconds=2.0, w=0.5).stood(0.1, 1.9)
    assert straight(0.0, 0.0, seconds=2.0).stood(0.1, 1.9)


def test_a_robot_at_rest_is_stood() -> None:
    track = segment_of((0.4, 1.0), (0.0, 1.0), (0.4, 1.0)).track
    assert not track.stood(0.1, 0.9)
    assert track.stood(0.9, 1.5)
    assert not track.stood(2.1, 2.9)


# Messages


def reader() -> Reader:
    return Reader(ROBOT, SOCCER)


def add_odometry(into: Reader, *times: float) -> None:
    make = Messages()
    for time in times:
        into.add(ODOM, make.odometry(Tick(time, Pose(0.1 * time, 0.0, 0.0), 0.1, 0.0)))


def test_a_silence_of_more_than_a_second_begins_a_segment() -> None:
    into = reader()
    add_odometry(into, 1.0, 2.0, 2.9)
    assert len(into.segments) == 1
    add_odometry(into, 4.0)
    assert [len(each.odom) for each in into.segments] == [3, 1]


def test_one_late_message_is_ignored_and_two_are_a_reset() -> None:
    into = reader()
    add_odometry(into, 5.0, 5.1, 4.9, 5.2)
    assert [len(each.odom) for each in into.segments] == [3]
    add_odometry(into, 1.0, 1.1, 1.2)
    assert [len(each.odom) for each in into.segments] == [3, 2]


def test_commands_get_the_stamp_of_the_last_odometry() -> None:
    into, make = reader(), Messages()
    into.add(CMD_VEL, make.twist(0.3, 0.0, 0.1))
    assert not into.has_both
    add_odometry(into, 1.0, 2.0)
    into.add(CMD_VEL, make.twist(0.3, 0.4, 0.1))
    assert into.has_both
    assert into.segments[0].cmd_vel.first == pytest.approx((2.0, 0.5, 0.1))


def ball_at(make: Messages, time: float) -> Any:
    return make.odometry(Tick(time, Pose(1.0, 2.0, 0.0), 0.0, 0.0))


def test_an_object_with_another_clock_is_left_out() -> None:
    into, make = reader(), Messages()
    add_odometry(into, 100.0)
    into.add("ball", ball_at(make, 100.2))
    into.add("ball", ball_at(make, 40.0))
    assert len(into.segments[0].objects["ball"]) == 1
    (remark,) = into.remarks()
    assert remark.startswith("left out 1 of 2 messages: ball.header.stamp: expected about")
    assert remark.endswith("got 40.00 s: another clock")


def links(*names: tuple[str, str]) -> Any:
    make = Messages()
    return make.transforms(1.0, *((*each, Pose(1.0, 0.0, 0.0)) for each in names))


def test_frames_in_tf_are_bounded() -> None:
    into = Reader(ROBOT, SOCCER, robot_in_tf=True)
    for first in range(0, 1000, 100):
        into.add("tf", links(*(("map", f"f{number}") for number in range(first, first + 100))))
    into.add("tf", links(("map", "f999")))
    assert into.left_out.total() == 0
    into.add("tf", links(("map", "one_more")))
    assert into.errors["tf"] == "tf: expected at most 1000 frames, got more"
    into = Reader(ROBOT, SOCCER, robot_in_tf=True)
    into.add("tf", links(("map", "a" * 256)))
    assert into.left_out.total() == 0
    into.add("tf", links(("map", "a" * 257)))
    into.add("tf", links(("b" * 257, "a")))
    assert into.left_out["tf"] == 2
    assert "at most 256 characters" in into.errors["tf"]


@pytest.mark.parametrize("frames", [["base_link", "camera"], ["base_footprint"]])
def test_the_robot_in_tf_replaces_odometry(frames: list[str]) -> None:
    into = Reader(ROBOT, SOCCER, robot_in_tf=True)
    into.add("tf", links(*(("odom", name) for name in frames)))
    assert into.segments[0].odom.first[:4] == pytest.approx((1.0, 1.0, 0.0, 0.0))
