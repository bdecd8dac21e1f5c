"""Drives through poses, as of NavigateThroughPoses: where the poses are, and a leg to each."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from bags import ODOMETRY, ROBOT, Messages, Tick, write_bag
from domain_files import changed, file_of

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.experience.recordings import read_recording
from ator_ros.experience.run_legs import legs_through, rows_of_poses
from ator_ros.experience.server_drives import Watch
from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.geometry import FloatArray, Pose
from ator_ros.learning.drive_monitor import DriveMonitor

SERVER = "navigate_through_poses"
EXECUTING, SUCCEEDED = 2, 4
POSES = (Pose(2.0, 0.0, 1.0), Pose(2.0, 2.0, -2.0), Pose(4.0, 2.0, 0.5))
SPEED, TICK = 0.5, 0.05


def line(start: Sequence[float], end: Sequence[float], step: float = 0.05) -> FloatArray:
    count = 1 + round(math.dist(start[:2], end[:2]) / step)
    return np.linspace(start[:2], end[:2], count)


def joined(poses: Sequence[Pose], heads: bool) -> tuple[FloatArray, FloatArray]:
    """Return the path of a planner; `heads`: with the headings of the poses where it ends."""
    places, headings = [], []
    start: Sequence[float] = (0.0, 0.0)
    for pose in poses:
        part = line(start, pose)
        along = math.atan2(*(part[-1] - part[0])[::-1])
        yaw = np.full(len(part), 0.0 if heads else along)
        yaw[-1] = pose.yaw if heads else along
        places.append(part)
        headings.append(yaw)
        start = pose
    return np.vstack(places), np.concatenate(headings)


@pytest.mark.parametrize("count", [0, 3])
@pytest.mark.parametrize("heads", [False, True])
def test_poses_are_where_the_parts_of_a_path_meet(heads: bool, count: int) -> None:
    path, headings = joined(POSES, heads)
    rows = rows_of_poses(path, headings, count)
    assert path[rows] == pytest.approx(np.array([pose[:2] for pose in POSES]))
    if heads:
        assert headings[rows[:-1]].tolist() in ([1.0, -2.0], [0.0, 0.0])


def test_headings_show_the_poses_of_paths_that_share_no_place() -> None:
    path, headings = joined(POSES, heads=True)
    apart = np.append(np.hypot(*np.diff(path, axis=0).T) > 0.0, True)
    apart = np.insert(apart[:-1], 0, True)  # each part begins beside the pose
    rows = rows_of_poses(path[apart], headings[apart], 3)
    assert path[apart][rows] == pytest.approx(np.array([pose[:2] for pose in POSES]))
    assert headings[apart][rows].tolist() == [pose.yaw for pose in POSES]


def test_corners_are_poses_if_their_number_is_known() -> None:
    path, _ = joined(POSES, heads=False)
    path = path[np.append(np.hypot(*np.diff(path, axis=0).T) > 0.0, True)]
    headings = np.linspace(0.0, 1.0, len(path))  # as a smoother writes them
    assert path[rows_of_poses(path, headings, 3)] == pytest.approx(
        np.array([pose[:2] for pose in POSES]), abs=0.06
    )
    assert rows_of_poses(path, headings, 0) == []
    assert rows_of_poses(path, headings, 6) == []
    assert rows_of_poses(path, headings, 1) == [len(path) - 1]


def driven(*corners: Sequence[float]) -> FloatArray:
    """Return times (s) and places (m) of a robot that drives along lines at 0.5 m/s."""
    parts = [line(a, b, SPEED * TICK) for a, b in itertools.pairwise(corners)]
    places = np.vstack([parts[0], *(part[1:] for part in parts[1:])])
    return np.column_stack([TICK * np.arange(len(places)), places])


def test_legs_end_where_the_robot_comes_within_the_tolerance() -> None:
    path, headings = joined(POSES, heads=True)
    rows = rows_of_poses(path, headings, 3)
    states = driven((0.0, 0.0), *(pose[:2] for pose in POSES))
    legs = list(legs_through(states, path, headings, rows, 0.3))
    assert [leg.is_passed for leg in legs] == [True, True, False]
    assert [leg.is_last for leg in legs] == [False, False, True]
    assert [leg.end for leg in legs] == pytest.approx([3.4, 7.4, 12.0], abs=0.051)
    assert [leg.begin for leg in legs] == [0.0, legs[0].end, legs[1].end]
    assert [leg.nearest for leg in legs[:2]] == pytest.approx([0.0, 0.0], abs=0.01)
    assert [leg.pose[:2] for leg in legs] == [pose[:2] for pose in POSES]


def test_a_pose_that_was_missed_is_a_failure_where_the_robot_was_nearest() -> None:
    path, headings = joined(POSES, heads=True)
    rows = rows_of_poses(path, headings, 3)
    states = driven((0.0, 0.0), (1.5, 0.0), (1.5, 2.0), (4.0, 2.0))
    missed, passed, last = legs_through(states, path, headings, rows, 0.3)
    assert (missed.is_passed, missed.is_last) == (False, False)
    assert missed.nearest == pytest.approx(0.5)
    assert missed.end == pytest.approx(3.0, abs=0.051)
    assert passed.is_passed
    assert last.end == pytest.approx(states[-1, 0])


# ---- as topics show it ---------------------------------------------------------------------------


def domain_in(folder: Path) -> Domain:
    fields = changed("tops.0.pre", [])
    fields["actions"][0]["remote"]["early"] = True
    return find_domain(str(file_of(folder, fields)))


def ticks() -> list[Tick]:
    """Return the states of a robot that stands, drives through the poses, and stands.

    At corners it turns on the spot.
    """
    found = [Tick(TICK * number, Pose(0.0, 0.0, 0.0), 0.0, 0.0) for number in range(20)]
    places = [(0.0, 0.0), *(pose[:2] for pose in POSES)]
    for start, end in itertools.pairwise(places):
        before = found[-1].pose.yaw
        yaw = math.atan2(end[1] - start[1], end[0] - start[0])
        turns = np.linspace(before, yaw, 21)[1:].tolist() if yaw != before else []
        moves = [(Pose(*start, turn), 0.0, (yaw - before) / 20 / TICK) for turn in turns]
        for x, y in line(start, end, SPEED * TICK)[1:].tolist():
            moves.append((Pose(x, y, yaw), SPEED, 0.0))
        for pose, v, w in moves:
            found.append(Tick(found[-1].time + TICK, pose, v, w))
    time, pose = found[-1][:2]
    found += [Tick(time + TICK * number, pose, 0.0, 0.0) for number in range(1, 21)]
    return found


BEGIN = 0.95
END = ticks()[-20].time


def status(make: Messages, tick: Tick) -> Any:
    changes = {BEGIN: EXECUTING, END: SUCCEEDED}
    code = next((code for time, code in changes.items() if abs(tick.time - time) < 0.01), None)
    if code is None:
        return None
    types = make.types
    goal_id = types["unique_identifier_msgs/msg/UUID"](np.full(16, 7, dtype=np.uint8))
    info = types["action_msgs/msg/GoalInfo"](goal_id, make.header(BEGIN, "").stamp)
    item = types["action_msgs/msg/GoalStatus"](info, code)
    return types["action_msgs/msg/GoalStatusArray"]([item])


def plan(make: Messages, tick: Tick) -> Any:
    if abs(tick.time - 1.2) > 0.01:
        return None
    path, headings = joined(POSES, heads=True)
    poses = []
    for (x, y), yaw in zip(path.tolist(), headings.tolist(), strict=True):
        turn = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
        header = make.header(tick.time, "odom")
        poses.append(make.types["geometry_msgs/msg/PoseStamped"](header, make.pose(x, y, turn)))
    return make.types["nav_msgs/msg/Path"](make.header(tick.time, "odom"), poses)


TOPICS = {f"{SERVER}/_action/status": status, "plan": plan, "odom": Messages.odometry}


def test_recorded_goals_teach_passing_leg_by_leg(tmp_path: Path) -> None:
    kinds = ("action_msgs/msg/GoalStatusArray", "nav_msgs/msg/Path", ODOMETRY)
    topics = [
        (f"/{name}", kind, make) for (name, make), kind in zip(TOPICS.items(), kinds, strict=True)
    ]
    bag = write_bag(tmp_path / "bag", Messages(), ticks(), *topics)
    read = read_recording(bag, ROBOT, domain_in(tmp_path))
    starts = read.frame[read.frame["t"] == 0.0]
    assert starts["action"].tolist() == ["navigate"] * 3
    assert starts["stopg"].tolist() == [0.0, 0.0, 1.0]
    assert (starts["v"].to_numpy()[1:] > 0.4).all()
    assert starts["success"].all()
    assert starts["duration"].sum() == pytest.approx(END - BEGIN, abs=0.01)
    assert starts[["xg", "yg"]].to_numpy() == pytest.approx(np.array([p[:2] for p in POSES]))
    assert starts["position_error"].to_numpy()[:2] == pytest.approx([0.0, 0.0], abs=0.01)


def test_watched_goals_teach_passing_leg_by_leg(tmp_path: Path) -> None:
    domain = domain_in(tmp_path)
    monitor = DriveMonitor(ROBOT, domain, "odom", WatchedPaths(tmp_path / PATHS))
    make = Messages()
    ended = []
    for tick in ticks():
        for role, factory in TOPICS.items():
            if (message := factory(make, tick)) is not None:
                monitor.watch.add(role, message)
        monitor.estimates()
        ended += monitor.ended()
    assert [drive.reason for drive in ended] == [""] * 3
    stops = [drive.episode and drive.episode.situation.goal.values["stop"] for drive in ended]
    assert stops == [0.0, 0.0, 1.0]
    assert len({drive.goal.goal_id for drive in ended}) == 3


def test_goals_whose_poses_are_unknown_are_not_learned_from(tmp_path: Path) -> None:
    watch = Watch(ROBOT, domain_in(tmp_path))
    make = Messages()
    for tick in ticks():
        watch.add("odom", make.odometry(tick))
        if (message := status(make, tick)) is not None:
            watch.add(f"{SERVER}/_action/status", message)
        if abs(tick.time - 1.2) < 0.01:
            header = make.header(tick.time, "odom")
            poses = [make.stamped(tick.time, *place) for place in ((0.0, 0.0), (4.0, 2.0))]
            watch.add("plan", Message(header=header, poses=poses))
    (goal,) = watch.take_ended()
    assert watch.legs(goal) == "its poses are unknown: its path does not show where they are"
