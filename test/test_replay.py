"""Recordings as a view plays them: the robot, its chains, and files that are none."""

from __future__ import annotations

import math
import os
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags: docs/install.md")

from chain_recording import ACTUAL, DURATION, GOALS, PREDICTED, RECORDS, Messages, write_recording, x_at

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.streams import Rows, Streams, Track
from ator_ros.tools import view
from ator_ros.viewing import replay_panel
from ator_ros.viewing.markdown import plain
from ator_ros.viewing.player import Player
from ator_ros.viewing.recorded import chain_of_record
from ator_ros.viewing.recording import RecordedRobot
from ator_ros.viewing.recording_file import read_robots


def only(file: Path) -> RecordedRobot:
    robots, left_out = read_robots(file, SOCCER)
    assert left_out == 0
    ((name, robot),) = robots.items()
    assert name == ""
    return robot


@pytest.mark.parametrize(
    "topics",
    [("odom", *RECORDS), ("odom", "performance/chain"), ("performance/chain",), ("performance/action",)],
)
def test_the_robot_and_its_chain_are_played(tmp_path: Path, topics: tuple[str, ...]) -> None:
    robot = only(write_recording(tmp_path / "bag", topics=topics))
    begin = 0.0 if "odom" in topics else 1.0  # without odometry the records tell where it was
    assert robot.duration == pytest.approx(DURATION if "odom" in topics else 6.0)
    for seconds in (0.0, 2.12, 5.0):
        world = robot.world(seconds)
        assert world.time == pytest.approx(begin + seconds)
        assert world.robot.pose == pytest.approx((x_at(world.time), 0.0, 0.0))
    assert (world.objects["ball"].x, world.objects["ball"].y) == (1.5, 0.5)
    (played,) = robot.chains
    assert (played.began, played.ended) == pytest.approx((1.0 - begin, 7.0 - begin))
    assert played.chain.goals == GOALS
    assert [step.predicted for step in played.chain.steps] == list(PREDICTED)
    assert [step.actual for step in played.chain.steps] == list(ACTUAL)
    assert played.chain.driven.refined == ("performance/chain" in topics)
    assert played.chain.driven.error == pytest.approx(sum(PREDICTED) - sum(ACTUAL))
    assert robot.history.chains == (played.chain.driven,)
    trail = robot.trail(played.began, played.ended, 20)
    assert 3 <= len(trail) <= 20
    assert (trail[0][0], trail[-1][0]) == pytest.approx((x_at(1.0), x_at(7.0)))


def test_a_chain_is_told_as_far_as_it_has_come(tmp_path: Path) -> None:
    robot = only(write_recording(tmp_path / "bag"))
    assert robot.chain(0.5) is None
    assert replay_panel.chain(None, 0.5, 0, 1) == "No chain yet; 1 is to come."
    played = robot.chain(5.5)
    assert "| driven | 3.00 | 1.50 | 4.50 |" in replay_panel.chain(played, 5.5, 1, 1)
    assert "| difference | -0.20 | - | - |" in replay_panel.chain(played, 5.5, 1, 1)
    assert replay_panel.chain(played, 7.5, 1, 1).splitlines() == [
        "Chain 1 of 1, refined:",
        "",
        "| s | goToBall | dribbleBall | chain |",
        "|---|---|---|---|",
        "| predicted | 2.80 | 3.50 | 6.30 |",
        "| driven | 3.00 | 3.00 | 6.00 |",
        "| difference | -0.20 | 0.50 | 0.30 |",
        "",
        r"gains \{0.50\} s (succeeded)",
    ]


def test_a_step_that_was_never_reached_is_told_too() -> None:
    record = Messages().chain()
    record.outcome.code, record.actions = 2, record.actions[:1]
    robot = RecordedRobot([straight(0.0, 8.0)], [(0, chain_of_record(record))])
    told = replay_panel.chain(robot.chains[0], 8.0, 1, 1)
    assert "| s | goToBall | dribbleBall | chain |" in told
    assert "| driven | 3.00 | - | - |" in told
    assert "(failed: done)" in told


def straight(begin: float, end: float, y: float = 0.0) -> Track:
    times = np.arange(begin, end + 1e-9, 0.05).tolist()
    return Track(Streams(odom=Rows(6, [(t, 0.5 * t, y, 0.0, 0.5, 0.0) for t in times])))


def test_where_nothing_was_recorded_no_time_passes() -> None:
    chain = chain_of_record(Messages().chain(later=3.0))  # from 4 s to 10 s, over a silence from 5 s to 9 s
    again = chain_of_record(Messages().chain())  # after a reset
    tracks = [straight(0.0, 5.0), straight(9.0, 11.0), straight(0.0, 8.0, y=1.0)]
    robot = RecordedRobot(tracks, [(1, chain), (2, again)])
    assert robot.duration == pytest.approx(15.0)
    spans = [(one.began, one.ended) for one in robot.chains]
    assert spans == [pytest.approx((4.0, 6.0)), pytest.approx((8.0, 14.0))]
    assert robot.world(5.5).time == pytest.approx(9.5)
    assert robot.world(7.5).robot.pose == pytest.approx((0.25, 1.0, 0.0))
    assert robot.trail(4.0, 7.5, 50)[0] == (0.0, 1.0)  # not across the jump
    there = robot.world_at_stamp(7.0)  # which was reached after the reset only
    assert there is not None
    assert there.robot.pose == pytest.approx((x_at(7.0) + 2.0, 1.0, 0.0))
    assert robot.world_at_stamp(20.0) is None


def test_a_state_between_others_is_as_of_the_whole_table() -> None:
    rng = np.random.default_rng(3)
    times = np.sort(np.append(rng.uniform(0.0, 5.0, 60), [2.0, 2.0, 2.0]))
    rows = np.column_stack([times, rng.normal(size=(63, 5))])
    track = Track(Streams(odom=Rows(6, rows.tolist())))
    for time in (*rng.uniform(-1.0, 6.0, 200).tolist(), 2.0, *times.tolist()):
        assert track.world(time).robot.v == np.interp(time, track.odom[:, 0], track.odom[:, 4])


def test_a_recording_of_days_fits_into_memory() -> None:
    # Three days at 100 Hz are 26 million rows of six numbers: 1.2 GB at 8 bytes each.
    tracemalloc.start()
    try:
        rows = Rows(6)
        for number in range(100_000):
            rows.append((1.7e9 + 0.01 * number, 0.1 * number, 0.2 * number, 0.3, 0.4, 0.5))
        track = Track(Streams(odom=rows))
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert track.world(1.7e9 + 500.0).robot.pose.x == pytest.approx(5000.0)
    assert held < 60 * 100_000


def test_rows_that_came_late_are_put_in_order() -> None:
    rows = Rows(3, [(1.0, 1.0, 0.0), (3.0, 3.0, 0.0), (2.0, 2.0, 0.0)])
    assert rows.in_order()[:, 1].tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="expected 3 numbers, got 2"):
        rows.append((4.0, 4.0))


def test_time_passes_stands_and_jumps() -> None:
    player = Player(8.0)
    for now in (100.0, 100.5, 101.0):
        player.tick(now)
    assert player.seconds == 1.0
    player.speed = 3.0
    player.tick(102.0)
    player.pause()
    player.tick(110.0)
    assert player.seconds == 4.0
    player.seek(-3.0)
    assert player.seconds == 0.0
    player.seek(7.0)
    player.play()
    player.tick(111.0)
    assert (player.seconds, player.playing) == (8.0, False)
    player.play()
    assert (player.seconds, player.playing) == (0.0, True)


def test_several_robots_are_played_at_one_stamp(tmp_path: Path) -> None:
    robots, _ = read_robots(write_recording(tmp_path / "bag", robots=("/ann", "/bob")), SOCCER)
    assert list(robots) == ["ann", "bob"]
    assert robots["bob"].world_at_stamp(4.0) == robots["ann"].world(4.0)
    assert robots["bob"].seconds_at(4.0) == pytest.approx(4.0)


def spoil_pose(record: Any) -> None:
    record.start.robot.position.x = math.nan


def spoil_goal(record: Any) -> None:
    record.chain.calls[-1].goal.pose.position.y = math.inf


@pytest.mark.parametrize("change", [spoil_pose, spoil_goal])
def test_a_chain_with_numbers_that_are_none_is_left_out(tmp_path: Path, change: Any) -> None:
    file = write_recording(tmp_path / "bag", topics=("odom", "performance/chain"), change=change)
    robots, left_out = read_robots(file, SOCCER)
    assert left_out == 1
    assert robots[""].chains == ()
    assert robots[""].duration == pytest.approx(DURATION)


def test_texts_of_others_are_no_markdown() -> None:
    assert plain("{window.x} <img src=a> | `b`") == r"\{window.x\} \<img src=a\> \| \`b\`"
    assert plain("a\nb\x1b[0m") == r"a\\nb\\x1b\[0m"


def cut(file: Path) -> Path:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    return file


def nothing_of_ours(file: Path) -> Path:
    from test_recordings import record

    record(file.parent.parent / "other", topics=("/cmd_vel",))
    return next((file.parent.parent / "other").glob("*.mcap"))


def another_type(file: Path) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = Messages().store
    kind, folder = "std_msgs/msg/String", file.parent.parent / "another"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        link = writer.add_connection("/odom", kind, typestore=store)
        writer.write(link, 0, store.serialize_cdr(store.types[kind]("I am no odometry"), kind))
    return folder


def empty(file: Path) -> Path:
    file.write_bytes(b"")
    return file


def pipe(file: Path) -> Path:
    file.unlink()
    os.mkfifo(file)
    return file


def with_a_pipe(file: Path) -> Path:
    return pipe(file).parent


FOREIGN = {
    "a pipe": (pipe, "is a pipe or a device"),
    "a folder with a pipe": (with_a_pipe, "is a pipe or a device"),
    "cut in the middle": (cut, "expected a recording of ros2 bag record -s mcap"),
    "empty": (empty, "expected a recording of ros2 bag record -s mcap"),
    "without our topics": (nothing_of_ours, "expected one of the topics odom, performance/chain or"),
    "of another type": (another_type, "skipped /odom: expected nav_msgs/msg/Odometry, got "),
    "a folder of something else": (lambda file: file.parent.parent, "expected the folder of an evaluation"),
    "missing": (lambda file: file.with_name("none.mcap"), "expected the folder of an evaluation"),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_no_recording_is_told_in_one_line(
    tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    make, told = FOREIGN[kind]
    file = make(write_recording(tmp_path / "bag"))
    assert view.main([str(file)]) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert line.startswith(f"view: {file}: ")
    assert told in line


def test_the_reading_of_a_long_recording_can_be_ended(tmp_path: Path) -> None:
    read: list[int] = []

    def going_on() -> None:
        read.append(1)
        if len(read) == 20:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        read_robots(write_recording(tmp_path / "bag"), SOCCER, going_on)
    assert len(read) == 20
