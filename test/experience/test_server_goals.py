"""Drives from recordings of an action server's goals: status, plan and tf, no records."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import ODOMETRY, ROBOT, TWIST, Extra, Messages, Tick, write_bag
from domain_files import changed, file_of

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.experience.recordings import read_recording
from ator_ros.experience.table import ExperienceError
from ator_ros.geometry import Pose

SPEED, TICK, LENGTH = 0.5, 0.05, 1.0
MAP = Pose(3.0, -2.0, 2.5)
"""Odometry's frame in the map."""
GOALS = ("succeeded", "aborted", "canceled", "without a plan", "by goal_pose", "unfinished")
PERIOD = LENGTH / SPEED + 0.5
BEGAN = 0.2  # s
CODES = {"aborted": 6, "canceled": 5}


def pose_at(time: float) -> Pose:
    """Return the pose in odometry's frame of a robot that drives 1 m to each goal."""
    number, since = divmod(time - BEGAN, PERIOD)
    return Pose(
        LENGTH * number + SPEED * min(since, LENGTH / SPEED) if time >= BEGAN else 0.0, 0.0, 0.0
    )


def ticks() -> list[Tick]:
    times = [TICK * number for number in range(round((PERIOD * (len(GOALS) - 0.5) + BEGAN) / TICK))]
    speeds = [(pose_at(time).x - pose_at(time - 0.001).x) / 0.001 for time in times]
    return [Tick(time, pose_at(time), v, 0.0) for time, v in zip(times, speeds, strict=True)]


def states_at(time: float) -> list[tuple[int, int, float]]:
    """Return number, status and time of acceptance of each goal.

    One is from before the recording.
    """
    begins = [(number, BEGAN + PERIOD * number) for number in range(len(GOALS))]
    states = [(99, 4, -50.0)]
    for number, begin in begins:
        if time >= begin - 0.001:
            ended = time >= begin + LENGTH / SPEED - 0.001
            states.append((number, CODES.get(GOALS[number], 4) if ended else 2, begin))
    return states


def status(make: Messages, tick: Tick) -> Any:
    """Return a status message where a state changes, and the latched one."""
    states, before = states_at(tick.time), states_at(tick.time - TICK)
    if states == before and tick.time > 0.0:
        return None
    types = make.types
    items = []
    for number, code, accepted in states:
        goal_id = types["unique_identifier_msgs/msg/UUID"](np.full(16, number, dtype=np.uint8))
        stamp = make.header(accepted, "").stamp
        items.append(
            types["action_msgs/msg/GoalStatus"](
                types["action_msgs/msg/GoalInfo"](goal_id, stamp), code
            )
        )
    return types["action_msgs/msg/GoalStatusArray"](items)


def goal_in_map(number: int) -> Pose:
    return MAP.compose(Pose(LENGTH * (number + 1), 0.1, 0.3))


def stamped_goal(make: Messages, time: float, number: int) -> Any:
    pose = goal_in_map(number)
    turn = math.sin(pose.yaw / 2.0), math.cos(pose.yaw / 2.0)
    return make.types["geometry_msgs/msg/PoseStamped"](
        make.header(time, "map"), make.pose(pose.x, pose.y, turn)
    )


def plan(make: Messages, tick: Tick) -> Any:
    """Return the path to the goal, once a second.

    That of a planner that stops short of a given goal_pose.
    """
    number, since = divmod(tick.time - BEGAN, PERIOD)
    if (
        not 0.0 <= number < len(GOALS)
        or round(since / TICK) % 20 != 10
        or GOALS[int(number)][:4] == "with"
    ):
        return None
    shown = int(number) if GOALS[int(number)] != "by goal_pose" else 0
    start = MAP.compose(tick.pose)
    begin = make.stamped(tick.time, start.x, start.y)
    poses = [begin, stamped_goal(make, tick.time, shown)]
    return make.types["nav_msgs/msg/Path"](make.header(tick.time, "map"), poses)


def goal_pose(make: Messages, tick: Tick) -> Any:
    number = GOALS.index("by goal_pose")
    sent = abs(tick.time - (BEGAN + PERIOD * number - 2 * TICK)) < 0.01
    return stamped_goal(make, tick.time, number) if sent else None


def transforms(make: Messages, tick: Tick) -> Any:
    return make.transforms(tick.time, ("map", "odom", MAP), ("odom", "base_link", tick.pose))


TF: Extra = ("/tf", "tf2_msgs/msg/TFMessage", transforms)
TOPICS: list[Extra] = [
    ("/navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray", status),
    ("/plan", "nav_msgs/msg/Path", plan),
    ("/goal_pose", "geometry_msgs/msg/PoseStamped", goal_pose),
]


@pytest.fixture
def domain(tmp_path: Path) -> Domain:
    return find_domain(str(file_of(tmp_path, changed("tops.0.pre", []))))


@pytest.mark.parametrize(("storage", "odometry"), [("MCAP", True), ("SQLITE3", False)])
def test_goals_of_a_server_are_drives(
    tmp_path: Path, domain: Domain, storage: str, odometry: bool
) -> None:
    states: list[Extra] = [("/odom", ODOMETRY, Messages.odometry)] if odometry else []
    bag = write_bag(
        tmp_path / "bag", Messages(offset=100.0), ticks(), *states, TF, *TOPICS, storage=storage
    )
    experience = read_recording(bag, ROBOT, domain)
    starts = experience.frame[experience.frame["t"] == 0.0]
    found = [0, 1, 4]
    assert starts["success"].tolist() == [True, False, True]
    assert starts["duration"].to_numpy() == pytest.approx(LENGTH / SPEED, abs=1.5 * TICK)
    goals = np.array([goal_in_map(number) for number in found])
    assert starts[["xg", "yg", "yawg"]].to_numpy() == pytest.approx(goals, abs=1e-6)
    begins = np.array([MAP.compose(Pose(LENGTH * number, 0.0, 0.0)) for number in found])
    assert starts[["x", "y", "yaw"]].to_numpy() == pytest.approx(begins, abs=1.5 * TICK * SPEED)
    assert starts["position_error"].to_numpy() == pytest.approx(0.1, abs=0.03)
    assert starts["heading_error"].to_numpy() == pytest.approx(0.3, abs=1e-6)
    reasons = {
        "accepted before the recording began",
        "canceled",
        "no plan or goal_pose was recorded with it",
        "its end was not recorded",
    }
    assert set(experience.remarks) == {
        f"bag: left out 1 of {len(GOALS) + 1} goals of navigate: {reason}" for reason in reasons
    }


def found_in(bag: Path, domain: Domain) -> int:
    return int(read_recording(bag, ROBOT, domain).frame["episode"].nunique())


@pytest.mark.parametrize("odometry", [True, False])
def test_all_topics_may_be_in_a_namespace(tmp_path: Path, domain: Domain, odometry: bool) -> None:
    states: list[Extra] = [("/odom", ODOMETRY, Messages.odometry)] if odometry else []
    topics = [(f"/robot1{name}", kind, make) for name, kind, make in [*states, TF, *TOPICS]]
    bag = write_bag(tmp_path / "bag", Messages(offset=100.0), ticks(), *topics)
    assert found_in(bag, domain) == 3


def test_a_robot_without_a_namespace_is_read_beside_one_in_a_namespace(
    tmp_path: Path, domain: Domain
) -> None:
    """The status topic of the other robot does not decide whose commands are read."""

    def no_goals(make: Messages, tick: Tick) -> Any:
        return make.types["action_msgs/msg/GoalStatusArray"]([])

    def stop(make: Messages, tick: Tick) -> Any:
        return make.twist(0.0, 0.0, 0.0)

    topics: list[Extra] = [
        ("/odom", ODOMETRY, Messages.odometry),
        ("/cmd_vel", TWIST, Messages.command),
        ("/robot1/cmd_vel", TWIST, stop),
        ("/robot1/navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray", no_goals),
    ]
    bag = write_bag(tmp_path / "bag", Messages(), ticks(), *topics)
    assert found_in(bag, domain) == len(GOALS) - 1  # the last drive has no end


def moving(child: str) -> Extra:
    """Return transforms as of a robot without base_link."""

    def make_transforms(make: Messages, tick: Tick) -> Any:
        return make.transforms(tick.time, ("map", "odom", MAP), ("odom", child, tick.pose))

    return ("/tf", "tf2_msgs/msg/TFMessage", make_transforms)


def test_the_only_frame_in_odom_is_the_robot(tmp_path: Path, domain: Domain) -> None:
    topics = (moving("base_footprint"), *TOPICS)
    bag = write_bag(tmp_path / "bag", Messages(offset=100.0), ticks(), *topics)
    assert found_in(bag, domain) == 3


def test_of_several_frames_in_odom_none_is_guessed(tmp_path: Path, domain: Domain) -> None:
    def others(make: Messages, tick: Tick) -> Any:
        links = ("odom", "camera", tick.pose), ("odom", "base_footprint", tick.pose)
        return make.transforms(tick.time, ("map", "odom", MAP), *links)

    topics = ("/tf", "tf2_msgs/msg/TFMessage", others), *TOPICS
    bag = write_bag(tmp_path / "bag", Messages(offset=100.0), ticks(), *topics)
    with pytest.raises(
        ExperienceError, match=r"tf: expected base_link, or a single frame, in odom"
    ):
        read_recording(bag, ROBOT, domain)


def test_without_transforms_the_frame_is_reported(tmp_path: Path, domain: Domain) -> None:
    states: Extra = ("/odom", ODOMETRY, Messages.odometry)
    bag = write_bag(tmp_path / "bag", Messages(offset=100.0), ticks(), states, *TOPICS)
    with pytest.raises(
        ExperienceError,
        match=r"left out 3 of 7 goals of navigate: tf: expected transforms from map to odom, got "
        r".* none",
    ):
        read_recording(bag, ROBOT, domain)
