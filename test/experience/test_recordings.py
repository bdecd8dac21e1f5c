"""Experience from recordings, written with rosbags."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bags import ROBOT, TICK, action_performance, drives, own_types, recorded, write_records
from mcap.reader import make_reader
from mcap.writer import Writer

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.recordings import read_recording
from ator_ros.experience.table import ExperienceError
from ator_ros.geometry import Pose
from ator_ros.tools import train


def test_drives_are_found_with_their_goals_and_durations(tmp_path: Path) -> None:
    experience = read_recording(recorded(tmp_path), ROBOT, SOCCER)
    frame = experience.of("goToPose")
    starts = frame[frame["t"] == 0.0]
    moving = [TICK * sum(tick.v != 0.0 or tick.w != 0.0 for tick in drive) for drive in drives()]
    assert starts["duration"].to_numpy() == pytest.approx(moving, abs=0.06)
    goals = np.array([drive[-1].pose[:2] for drive in drives()])
    assert starts[["xg", "yg"]].to_numpy() == pytest.approx(goals, abs=0.01)
    assert np.allclose(frame["t"] + frame["time_to_go"], frame["duration"])
    assert set(frame["hold"]) == {0}
    assert starts["v"].abs().max() < 0.05
    assert experience.metadata["robot_digest"] == ROBOT.digest()


def test_the_robots_clock_may_jump_between_drives(tmp_path: Path) -> None:
    usual, jumped = (
        read_recording(recorded(tmp_path / str(jump), jump=jump), ROBOT, SOCCER).frame
        for jump in (0.0, -2.0)
    )
    assert jumped["duration"].max() == pytest.approx(usual["duration"].max())


def test_definitions_of_services_and_actions_are_skipped(tmp_path: Path) -> None:
    recorded(tmp_path)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    with file.open("rb") as old, (tmp_path / "again.mcap").open("wb") as new:
        writer, ids = Writer(new), {}
        writer.start("ros2")
        for number, encoding in enumerate(("ros2msg", "unknown")):
            name, text = (
                f"dock/srv/Dock{number}_Event",
                b"string name\n---\nbool done" if not number else b"",
            )
            ids[name] = writer.register_schema(name, encoding, text)
            writer.register_channel(f"/dock{number}", "cdr", ids[name])
        for schema, channel, message in make_reader(old).iter_messages():
            if channel.topic not in ids:
                ids[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(channel.topic, "cdr", ids[schema.name])
            writer.add_message(
                ids[channel.topic], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    whole, again = (
        read_recording(path, ROBOT, SOCCER).frame for path in (file, tmp_path / "again.mcap")
    )
    pd.testing.assert_frame_equal(again, whole)


def test_a_recording_without_the_topics_is_rejected(tmp_path: Path) -> None:
    recorded(tmp_path, cmd_vel="/other")
    with pytest.raises(
        ExperienceError, match=r"or odom \(Odometry\) and cmd_vel .*: /odom, /other; name"
    ):
        read_recording(tmp_path / "bag", ROBOT, SOCCER)


def test_a_missing_package_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(tmp_path)
    for package, file in (("mcap_ros2.decoder", "bag"), ("pyarrow", "experience.parquet")):
        monkeypatch.delitem(sys.modules, "ator_ros.experience.bag_files", raising=False)
        monkeypatch.setitem(sys.modules, package, None)
        assert train.main([str(tmp_path / file), "--models", str(tmp_path)]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert package in line
        assert line.endswith("docs/install.md describes how to install it")


@pytest.mark.parametrize("former_velocity", [False, True])
def test_records_of_the_executor_are_read_unchanged(tmp_path: Path, former_velocity: bool) -> None:
    store = own_types(former_velocity=former_velocity)
    record = action_performance(store, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=3.25, code=1)
    failed = action_performance(store, goal=Pose(2.5, 0.5, 0.7), speed=0.0, duration=9.0, code=2)
    canceled = action_performance(store, goal=Pose(2.5, 0.5, 0.7), speed=0.0, duration=1.0, code=4)
    write_records(tmp_path / "bag", store, [record, failed, canceled])
    frame = read_recording(tmp_path / "bag", ROBOT, SOCCER).of("goToPose")
    assert frame["duration"].tolist() == [3.25, 9.0]
    assert frame["success"].tolist() == [True, False]
    columns = ["x", "y", "v", "vy", "xg", "yg", "speedg", "hold"]
    assert frame[columns].iloc[0].tolist() == [-1, 0.25, 0.1, 0, 1.5, 0.5, 0.3, 1]
    assert frame["yawg"].iloc[0] == pytest.approx(0.7)
    assert frame["position_error"].iloc[0] == 0.01


def test_odometry_beside_records_is_not_judged(tmp_path: Path) -> None:
    store = own_types()
    record = action_performance(store, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=3.25, code=1)
    write_records(tmp_path / "records", store, [record])
    bags = [tmp_path / "records", recorded(tmp_path, slip=0.1)]
    experience = read_recording(bags, ROBOT, SOCCER)
    assert experience.frame["duration"].tolist() == [3.25]
    assert experience.remarks == ()


def test_records_that_cannot_be_used_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = own_types()

    def made(**given: Any) -> Any:
        usual = {"goal": Pose(1.5, 0.5, 0.7), "speed": 0.0, "duration": 3.0, "code": 1}
        return action_performance(store, **usual | given)

    good = [
        made(duration=2.0 + 0.1 * number, start=(-1.0 + 0.1 * number, 0.0)) for number in range(25)
    ]
    good.append(made(code=2, start=(-90.0, 0.0)))  # it failed
    bad = [
        made(action="shoot", top="goToPose"),
        made(action="goToPose", top="shoot"),
        made(top="visit"),
        made(start=(-90.0, 0.0)),  # too far for 3 s
        made(code=2, start=(0.0, 5000.0)),
        made(action="shoot", top="shoot", start=(-900.0, 0.0)),
        made(duration=np.nan),
        made(duration=-1.0),
        made(goal=Pose(np.inf, 0.5, 0.7)),
        made(goal=Pose(1.5, 0.5, np.nan), code=2),
    ]
    for place in (np.inf, 2e8):
        bad.append(made())
        bad[-1].start.objects[0].position.x = place
    bad += [made(), made()]
    bad[-2].heading_error = np.inf
    bad[-1].start.objects[0].name = "b" * 1_000
    write_records(tmp_path / "bag", store, [*good, *bad])
    experience = read_recording(tmp_path / "bag", ROBOT, SOCCER)
    assert len(experience.of("goToPose")) == len(good)
    assert train.main([str(tmp_path / "bag"), "--models", str(tmp_path / "models")]) == 0
    output = capsys.readouterr().err
    assert (
        f"train: bag: left out {len(bad)} of {len(good) + len(bad)} records: call.top: expected"
        in output
    )
