"""Recordings of real robots: stamps, topics, types, frames and quaternions of various drivers."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bags import HEADINGS, ODOMETRY, TICK, TWIST, Messages, Tick, drives, recorded, write_bag
from domain_files import file_of, visiting

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.recordings import read_recording
from ator_ros.experience.table import Experience, ExperienceError
from ator_ros.geometry import Pose
from ator_ros.tools import train

ROBOT = SOCCER.robot(None)
POSES = "geometry_msgs/msg/PoseStamped"


def read(bag: Path, domain: Domain = SOCCER) -> Experience:
    return read_recording(bag, ROBOT, domain)


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Return the table of the recording without oddities."""
    experience = read(recorded(tmp_path_factory.mktemp("usual")))
    assert experience.frame["episode"].nunique() == len(HEADINGS)
    assert experience.remarks == ()
    return experience.frame


def test_stamps_of_any_clock_give_the_same_table(tmp_path: Path, usual: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(read(recorded(tmp_path, offset=1.76e9)).frame, usual)


def test_projected_coordinates_give_the_same_table_elsewhere(
    tmp_path: Path, usual: pd.DataFrame
) -> None:
    place = 691_608.25, 5_334_761.5
    frame = read(recorded(tmp_path, place=place, offset=1.76e9)).frame
    moved = frame.assign(
        x=frame["x"] - place[0],
        y=frame["y"] - place[1],
        xg=frame["xg"] - place[0],
        yg=frame["yg"] - place[1],
    )
    pd.testing.assert_frame_equal(moved, usual, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("oddity", [{"length": 1.5}, {"in_world": True, "frame": "/odom"}])
def test_repaired_messages_give_the_same_table(
    tmp_path: Path, usual: pd.DataFrame, oddity: dict[str, Any]
) -> None:
    experience = read(recorded(tmp_path, **oddity))
    pd.testing.assert_frame_equal(experience.frame, usual, rtol=0.0, atol=1e-12)
    assert experience.remarks == ()


CONTRADICTION = "bag: odom: twist.linear and poses contradict each other; the poses decide"


@pytest.mark.parametrize("slip", [-1.0, 0.0, 0.1])
def test_where_pose_and_twist_contradict_each_other_the_poses_decide(
    tmp_path: Path, usual: pd.DataFrame, slip: float
) -> None:
    experience = read(recorded(tmp_path, slip=slip))
    assert experience.remarks == (CONTRADICTION,)
    starts, expected = (rows[rows["t"] == 0.0] for rows in (experience.frame, usual))
    assert starts["driven"].to_numpy() == pytest.approx(expected["driven"].to_numpy(), abs=0.02)
    assert starts["duration"].to_numpy() == pytest.approx(expected["duration"].to_numpy(), abs=1e-6)
    off = np.abs(experience.frame["v"] - usual["v"])
    assert off.mean() < 0.01
    assert off.max() < 0.2  # where the robot starts at once with 0.4 m/s


def test_a_long_drive_with_half_of_its_speed_is_read_as_its_poses_show(tmp_path: Path) -> None:
    ticks, pose = list[Tick](), Pose(0.3, -0.2, 0.0)
    for v, count in ((0.0, 20), (0.3, 300), (0.0, 30)):  # 300 ticks are 12 s
        for _ in range(count):
            ticks.append(Tick(TICK * len(ticks), pose, v, 0.0))
            pose = Pose(pose.x + TICK * v, pose.y, 0.0)
    read_with = {}
    for slip in (1.0, 0.5):
        odometry = "/odom", ODOMETRY, partial(Messages.odometry, slip=slip)
        topics = odometry, ("/cmd_vel", TWIST, Messages.command)
        read_with[slip] = read(write_bag(tmp_path / f"{slip}" / "bag", Messages(), ticks, *topics))
    right, halved = read_with[1.0], read_with[0.5]
    assert right.frame["duration"].iloc[0] == pytest.approx(12.0, abs=TICK)
    assert halved.frame["duration"].iloc[0] == right.frame["duration"].iloc[0]
    assert halved.frame["v"].iloc[2:].to_numpy() == pytest.approx(0.3, abs=1e-6)
    assert halved.remarks == (CONTRADICTION,)


def test_an_unsigned_twist_gets_its_sign_from_the_poses(tmp_path: Path) -> None:
    """The robot of these drives moves backward; its driver reports speeds without signs."""
    ticks = [
        tick._replace(pose=Pose(tick.pose.x, tick.pose.y, tick.pose.yaw + np.pi), v=-tick.v)
        for drive in drives()
        for tick in drive
    ]

    def unsigned(make: Messages, tick: Tick) -> Any:
        return make.odometry(tick._replace(v=abs(tick.v)))

    topics = ("/odom", ODOMETRY, unsigned), ("/cmd_vel", TWIST, Messages.command)
    experience = read(write_bag(tmp_path / "bag", Messages(), ticks, *topics))
    starts = experience.frame[experience.frame["t"] == 0.0]
    assert starts["driven"].to_numpy() == pytest.approx(-0.64, abs=0.05)
    assert experience.frame["v"].max() < 0.05


@pytest.mark.parametrize("jump", [(3.0, 1.0), (5e4, 2e5)])
def test_drives_in_which_the_pose_jumps_are_left_out(
    tmp_path: Path, jump: tuple[float, float]
) -> None:
    made = drives()
    jumped = []
    for number, drive in enumerate(made):
        for place, tick in enumerate(drive):
            moved = number > 2 or (number == 2 and place > len(drive) - 50)
            x, y = jump if moved else (0.0, 0.0)
            pose = Pose(tick.pose.x + x, tick.pose.y + y, tick.pose.yaw)
            jumped.append(tick._replace(pose=pose))
    topics = ("/odom", ODOMETRY, Messages.odometry), ("/cmd_vel", TWIST, Messages.command)
    experience = read(write_bag(tmp_path / "bag", Messages(), jumped, *topics))
    assert experience.frame["episode"].nunique() == len(made) - 1
    assert experience.remarks == (
        f"bag: left out 1 of {len(made)} drives: the pose jumps during the drive",
    )
    starts = experience.frame[experience.frame["t"] == 0.0]
    lengths = np.hypot(starts["xg"] - starts["x"], starts["yg"] - starts["y"])
    assert lengths.to_numpy() == pytest.approx(0.64, abs=0.05)


def test_messages_without_orientation_are_omitted_and_counted(
    tmp_path: Path, usual: pd.DataFrame
) -> None:
    def without_some(make: Messages, tick: Tick) -> Any:
        return make.odometry(tick, length=0.0 if round(tick.time / TICK) % 7 == 3 else 1.0)

    topics = ("/robot/odom", ODOMETRY, without_some), ("/robot/cmd_vel", TWIST, Messages.command)
    experience = read(recorded(tmp_path, *topics, odom="/x"))
    assert experience.frame["duration"].to_numpy() == pytest.approx(
        usual["duration"].to_numpy(), abs=TICK
    )
    (line,) = experience.remarks
    assert "messages: odom.pose.pose.orientation: expected a quaternion" in line


def test_odometry_of_which_nothing_can_be_used_is_named(tmp_path: Path) -> None:
    bag = recorded(tmp_path, length=0.0)
    expected = r"expected odometry that can be used, found none; left out .* odom\.pose\.pose\."
    with pytest.raises(ExperienceError, match=expected) as refused:
        read_recording(bag, ROBOT, SOCCER)
    assert "--odom" not in str(refused.value)


@pytest.mark.parametrize("topic", ["/v/odom", "/v/ball"])
def test_a_topic_of_another_type_is_skipped_and_reported(
    tmp_path: Path, usual: pd.DataFrame, topic: str
) -> None:
    def pose(make: Messages, tick: Tick) -> Any:
        return make.stamped(tick.time, 1.0, 2.0)

    experience = read(recorded(tmp_path, (topic, POSES, pose)))
    pd.testing.assert_frame_equal(experience.frame, usual)
    (line,) = experience.remarks
    assert line.startswith(f"bag: skipped {topic}: expected ")
    assert line.endswith(", got geometry_msgs/msg/PoseStamped")


def test_of_several_robots_one_is_read(tmp_path: Path, usual: pd.DataFrame) -> None:
    other = ("/b/odom", ODOMETRY, Messages.odometry), ("/b/cmd_vel", TWIST, Messages.command)
    bag = recorded(tmp_path, *other, odom="/a/odom", cmd_vel="/a/cmd_vel")
    with pytest.raises(
        ExperienceError, match="skipped /a/odom, /b/odom: expected one of them as odom"
    ):
        read(bag)
    pd.testing.assert_frame_equal(
        read_recording(bag, ROBOT, SOCCER, {"odom": "/a/odom"}).frame, usual
    )


DRIVER = {"odom": "/base/wheel_odometry", "cmd_vel": "/base/command"}
NAMES = ["--odom", DRIVER["odom"], "--cmd-vel", "base/command"]


def test_topics_can_be_given_and_are_listed_otherwise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = recorded(tmp_path, **DRIVER)
    words = [str(bag), "--models", str(tmp_path / "models")]
    for given in ([], NAMES[:2], NAMES[2:]):
        assert train.main([*words, *given]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert (
            "topics of these types: /base/command, /base/wheel_odometry; name them with --odom"
            in line
        )
    assert train.main([*words, *NAMES]) == 0
    assert f"{len(HEADINGS)} drives correct path times" in capsys.readouterr().err


def errands(folder: Path, **cart: str) -> Domain:
    return find_domain(str(file_of(folder, visiting(cart, "goal"))))


@pytest.mark.parametrize("topic", ["tracker/cart_pose", "/tracker/cart_pose"])
def test_an_object_is_read_from_its_declared_source(tmp_path: Path, topic: str) -> None:
    def tracked(make: Messages, tick: Tick) -> Any:
        return make.stamped(tick.time, 1.5 + 0.01 * tick.time, -0.5)

    domain = errands(tmp_path, topic=topic, type="PoseStamped")
    bag = recorded(tmp_path, ("/tracker/cart_pose", POSES, tracked), offset=1.76e9)
    experience = read(bag, domain)
    frame = experience.frame
    assert set(frame["cart_y"]) == {-0.5}
    starts = frame[frame["t"] == 0.0]["cart_x"].to_numpy()
    assert (np.diff(starts) > 0.01).all()
    assert experience.remarks == ()


def test_an_object_in_tf_is_read(tmp_path: Path) -> None:
    def transforms(make: Messages, tick: Tick) -> Any:
        return make.transforms(tick.time, ("/odom", "cart_link", Pose(1.5, tick.time, 0.0)))

    domain = errands(tmp_path, type="tf", frame="/cart_link")
    frame = read(recorded(tmp_path, ("/tf", "tf2_msgs/msg/TFMessage", transforms)), domain).frame
    later = frame[frame["episode"] > 0]
    assert set(later["cart_x"]) == {1.5}
    assert later["cart_y"].is_monotonic_increasing
