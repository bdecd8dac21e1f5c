"""Files of recordings: compressed, damaged, hostile, of an earlier ROS, or in several parts."""

import os
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import threading
import tracemalloc
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import zstandard
from bags import (
    ODOMETRY,
    ROBOT,
    TWIST,
    Messages,
    action_performance,
    drives,
    own_types,
    recorded,
    write_bag,
    write_records,
)
from mcap.writer import CompressionType, Writer

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.bag_files import Bag
from ator_ros.experience.recordings import read_recording, read_sources
from ator_ros.experience.table import Experience, ExperienceError
from ator_ros.geometry import Pose
from ator_ros.tools import train

MEGABYTE = 1 << 20
MOST = 64 * MEGABYTE
"""Bytes that reading a small file may need at once."""
ODOM = ("/odom", ODOMETRY, Messages.odometry)
CMD_VEL = ("/cmd_vel", TWIST, Messages.command)


def read(bag: Path) -> Experience:
    return read_recording(bag, ROBOT, SOCCER)


def ticks() -> list[Any]:
    return [tick for drive in drives() for tick in drive]


def in_sqlite(folder: Path) -> Path:
    """Return the file of a recording in SQLite."""
    bag = write_bag(folder / "bag", Messages(), ticks(), ODOM, CMD_VEL, storage="SQLITE3")
    (file,) = bag.glob("*.db3")
    return file


def change(file: Path, *statements: str) -> None:
    database = sqlite3.connect(file)
    for statement in statements:
        database.execute(statement)
    database.commit()
    database.close()


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    return read(recorded(tmp_path_factory.mktemp("usual"))).frame


def chunked(
    file: Path,
    compression: CompressionType = CompressionType.NONE,
    size: int = 20_000,
    data: bytes | None = None,
) -> Path:
    """Write a recording in MCAP with many chunks; `data` replaces all messages."""
    make = Messages()
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=size, compression=compression)
        writer.start("ros2")
        channels = {}
        for topic, kind, _ in (ODOM, CMD_VEL):
            text, _ = make.store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for number, tick in enumerate(ticks()):
            for topic, kind, factory in (ODOM, CMD_VEL):
                content = data or bytes(make.store.serialize_cdr(factory(make, tick), kind))
                writer.add_message(channels[topic], 1000 * number, content, 1000 * number)
        writer.finish()
    return file


# What other recorders and settings write


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("mode", ["MESSAGE", "FILE"])
def test_compressed_recordings_give_the_same_table(
    tmp_path: Path, usual: pd.DataFrame, storage: str, mode: str
) -> None:
    bag = write_bag(
        tmp_path / "bag", Messages(), ticks(), ODOM, CMD_VEL, storage=storage, compressed=mode
    )
    experience = read(bag)
    pd.testing.assert_frame_equal(experience.frame, usual)
    assert experience.remarks == ()
    (file,) = (each for each in bag.iterdir() if each.suffix != ".yaml")
    assert read_sources([file], ROBOT, SOCCER).frame["episode"].nunique() == len(drives())


@pytest.mark.parametrize("compression", list(CompressionType))
def test_chunks_of_any_compression_are_read(
    tmp_path: Path, usual: pd.DataFrame, compression: CompressionType
) -> None:
    pd.testing.assert_frame_equal(read(chunked(tmp_path / "a.mcap", compression)).frame, usual)


def test_a_recording_without_definitions_is_read(tmp_path: Path, usual: pd.DataFrame) -> None:
    file = in_sqlite(tmp_path)
    change(file, "DROP TABLE message_definitions")
    pd.testing.assert_frame_equal(read(file).frame, usual)


def test_former_records_without_definitions_are_said_to_be_those_of_another_release(
    tmp_path: Path,
) -> None:
    store = own_types(former_velocity=True)
    record = action_performance(store, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=3.25, code=1)
    write_records(tmp_path / "bag", store, [record, record], "SQLITE3")
    file = next((tmp_path / "bag").glob("*.db3"))
    change(file, "DROP TABLE message_definitions")
    with pytest.raises(ExperienceError) as caught:
        read(file)
    text = str(caught.value)
    assert "performance/action: expected records that can be used, found none; skipped" in text
    assert "no definition of ator_interfaces/msg/ActionPerformance, and they are not those" in text


def test_definitions_may_be_stored_as_bytes(tmp_path: Path, usual: pd.DataFrame) -> None:
    file = in_sqlite(tmp_path)
    change(
        file,
        "UPDATE message_definitions SET "
        "encoded_message_definition = CAST(encoded_message_definition AS BLOB)",
        "INSERT INTO message_definitions VALUES (9, 'a/msg/B', 'ros2msg', x'80ff', '')",
    )
    experience = read(file)
    assert experience.remarks == ()
    pd.testing.assert_frame_equal(experience.frame, usual)


@pytest.mark.parametrize("apart", [False, True])
def test_several_files_of_one_recording_are_merged(
    tmp_path: Path, usual: pd.DataFrame, apart: bool
) -> None:
    sources = []
    for number, topic in enumerate((ODOM, CMD_VEL)):
        bag = write_bag(tmp_path / str(number), Messages(), ticks(), topic)
        (file,) = bag.glob("*.mcap")
        sources.append(bag)
        if not apart:
            (tmp_path / "both").mkdir(exist_ok=True)
            shutil.copy(file, tmp_path / "both" / f"{number}.mcap")
            sources = [tmp_path / "both"]
    experience = read_sources(sources, ROBOT, SOCCER)
    assert experience.frame["duration"].to_numpy() == pytest.approx(
        usual["duration"].to_numpy(), abs=0.05
    )


def test_a_recording_beside_its_copy_counts_once(tmp_path: Path, usual: pd.DataFrame) -> None:
    bag = recorded(tmp_path)
    (file,) = bag.glob("*.mcap")
    shutil.copy(file, tmp_path / "recovered.mcap")
    apart = read_sources([file, tmp_path / "recovered.mcap"], ROBOT, SOCCER)
    pd.testing.assert_frame_equal(apart.frame, usual)
    assert apart.remarks == (
        f"{len(drives())} of {2 * len(drives())} episodes are repeated and count once",
    )
    shutil.copy(file, bag / "recovered.mcap")
    together = read(bag)
    pd.testing.assert_frame_equal(together.frame, usual)
    (remark,) = together.remarks
    assert remark == f"bag: skipped {2 * len(ticks())} messages that were recorded twice"


def test_the_same_table_twice_counts_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = own_types()
    records = [
        action_performance(
            store, goal=Pose(1.5, 0.5, 0.7), speed=0.0, duration=3.0 + 0.1 * number, code=1
        )
        for number in range(12)
    ]
    write_records(tmp_path / "bag", store, records)
    bag = str(tmp_path / "bag")
    assert train.main([bag, bag, "--models", str(tmp_path)]) == 0
    lines = capsys.readouterr().err
    assert "12 of 24 episodes are repeated and count once" in lines
    assert "12 drives correct path times" in lines


def test_stamps_of_zero_are_named(tmp_path: Path) -> None:
    still = "/odom", ODOMETRY, lambda make, tick: make.odometry(tick._replace(time=0.0))
    bag = write_bag(tmp_path / "bag", Messages(), ticks(), still, CMD_VEL)
    with pytest.raises(ExperienceError, match=r"expected stamps that increase, got 0 s in all \d+"):
        read(bag)


# Damaged files


def test_chunks_with_a_wrong_crc_are_skipped(tmp_path: Path, usual: pd.DataFrame) -> None:
    content = bytearray(chunked(tmp_path / "a.mcap").read_bytes())
    for place in (len(content) // 3, len(content) // 2):
        content[place] ^= 0xFF
    (tmp_path / "b.mcap").write_bytes(content)
    experience = read(tmp_path / "b.mcap")
    assert experience.remarks == ("b.mcap: skipped 2 chunks with a wrong CRC",)
    assert experience.frame["episode"].nunique() == len(drives())


def end_of_records(content: bytes) -> int:
    """Return where the last whole record of a file in MCAP ends."""
    end = place = 8
    while place <= len(content):
        end = place
        place += 9 + int.from_bytes(content[place + 1 : place + 9], "little")
    return end


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_a_recording_that_was_cut_off_is_read_to_there(tmp_path: Path, storage: str) -> None:
    file = in_sqlite(tmp_path) if storage == "db3" else chunked(tmp_path / "a.mcap")
    content = file.read_bytes()
    begin = int(0.6 * len(content))
    cut = tmp_path / f"cut.{storage}"
    cut.write_bytes(content[:begin] + (b"" if storage == "mcap" else bytes(len(content) - begin)))
    experience = read(cut)
    assert 1 <= experience.frame["episode"].nunique() < len(drives())
    (remark,) = experience.remarks
    where = f"{end_of_records(content[:begin]):,} bytes: " if storage == "mcap" else "row "
    assert remark.startswith(f"cut.{storage}: skipped the end, after {where}")


# Large files


def test_reading_can_be_interrupted_during_a_long_query(
    tmp_path: Path, usual: pd.DataFrame
) -> None:
    file = in_sqlite(tmp_path)
    change(
        file,
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 1000000) "
        "INSERT INTO message_definitions SELECT i + 9, 'a', 'b', 'c', '' FROM n",
    )
    interrupt = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
    interrupt.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            read(file)
    finally:
        interrupt.cancel()


PEAK = """
import sys
from pathlib import Path
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.recordings import read_recording
remarks = read_recording(Path(sys.argv[1]), SOCCER.robot(None), SOCCER).remarks
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(status["VmHWM"].split()[0], *remarks)  # not ru_maxrss, which includes that of the parent
"""
"""Prints the greatest memory in KiB that a process needed to read a recording, and the remarks."""


def peak(file: Path) -> tuple[int, str]:
    """Return the greatest resident memory in bytes of a process that reads a file, and remarks."""
    words = [sys.executable, "-c", PEAK, str(file)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    kibibytes, _, remarks = said.partition(" ")
    return 1024 * int(kibibytes), remarks


@pytest.mark.long
def test_the_memory_of_the_process_does_not_grow_with_the_file(tmp_path: Path) -> None:
    """The file has 300 MB of messages on a topic that is read, which cannot be decoded."""
    small = chunked(tmp_path / "small.mcap")
    large = tmp_path / "large.mcap"
    noise = os.urandom(3 * MEGABYTE)
    with large.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2")
        text, _ = Messages().store.generate_msgdef(ODOMETRY, ros_version=2)
        schema = writer.register_schema(ODOMETRY, "ros2msg", text.encode())
        channel = writer.register_channel("/odom", "cdr", schema)
        for number in range(100):
            writer.add_message(channel, number, b"\xff" * 100 + noise, number)
        writer.finish()
    (tmp_path / "both").mkdir()
    shutil.copy(small, tmp_path / "both")
    large.rename(tmp_path / "both" / large.name)
    usual, _ = peak(small)
    needed, remarks = peak(tmp_path / "both")
    assert "skipped 100 messages on /odom" in remarks
    assert needed < usual + 100 * MEGABYTE  # a chunk, and messages to be put in order


# Hostile files

ENDLESS = "WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) SELECT n AS id, "
PROGRAMS = {
    "topics": [
        "DROP TABLE topics",
        "CREATE VIEW topics AS " + ENDLESS + "'/odom' AS name, 'a' AS type, "
        "'cdr' AS serialization_format FROM r",
    ],
    "messages": [
        "DROP TABLE messages",
        "CREATE VIEW messages AS " + ENDLESS + "1 AS topic_id, n AS timestamp, "
        "zeroblob(9) AS data FROM r",
    ],
    "column": [
        "DROP TABLE messages",
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data AS (zeroblob(900000000)))",
        "INSERT INTO messages (topic_id, timestamp) VALUES (1, 1)",
    ],
    "virtual": [
        "DROP TABLE topics",
        "CREATE VIRTUAL TABLE topics USING fts5(id, name, type, serialization_format)",
    ],
    "definitions": [
        "DROP TABLE message_definitions",
        "CREATE VIEW message_definitions AS " + ENDLESS + "'a' AS topic_type, "
        "'ros2msg' AS encoding, 'a' AS encoded_message_definition FROM r",
    ],
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_only_stored_tables_are_read(tmp_path: Path, name: str) -> None:
    file = in_sqlite(tmp_path)
    change(file, *PROGRAMS[name])
    with pytest.raises(ExperienceError, match="no recording of ros2 bag record") as raised:
        read(file)
    assert len(str(raised.value)) - len(str(file)) < 200


def bomb(size: int) -> bytes:
    """Return `size` zeros, compressed."""
    stream = zstandard.ZstdCompressor().compressobj()
    return (
        b"".join(stream.compress(bytes(MEGABYTE)) for _ in range(size // MEGABYTE)) + stream.flush()
    )


def repeated_bomb(file: Path) -> None:
    """Write 80 kB whose chunks have 400 MB of messages."""
    record = struct.pack("<BQHIQQ1000x", 5, 1022, 1, 0, 0, 0)
    records = record * (10 * MEGABYTE // len(record))
    packed = zstandard.ZstdCompressor().compress(records)
    chunk = struct.pack("<QQQII4sQ", 0, 1, len(records), 0, 4, b"zstd", len(packed)) + packed
    content = chunked(file, CompressionType.ZSTD).read_bytes()
    part = struct.pack("<BQ", 6, len(chunk)) + chunk
    file.write_bytes(content[:8] + 40 * part + content[8:])


def zeros_bomb(file: Path) -> None:
    packed = bomb(16 * MEGABYTE)
    chunk = struct.pack("<QQQII4sQ", 0, 1, 16 * MEGABYTE, 0, 4, b"zstd", len(packed)) + packed
    content = chunked(file).read_bytes()
    file.write_bytes(content[:8] + struct.pack("<BQ", 6, len(chunk)) + chunk + content[8:])


def messages_bomb(file: Path) -> None:
    chunked(file, data=bomb(200 * MEGABYTE))


def chunk_bomb(file: Path, claimed: int) -> None:
    packed = bomb(200 * MEGABYTE)
    chunk = struct.pack("<QQQII4sQ", 0, 1, claimed, 0, 4, b"zstd", len(packed)) + packed
    content = chunked(file).read_bytes()
    file.write_bytes(content[:8] + struct.pack("<BQ", 6, len(chunk)) + chunk + content[8:])


def file_bomb(file: Path) -> None:
    file.write_bytes(bomb(200 * MEGABYTE))


BOMBS: dict[str, Any] = {
    "messages": (messages_bomb, "a.mcap", "expected at most 4 MiB, and 200 times its size"),
    "large chunk": (lambda file: chunk_bomb(file, 200 * MEGABYTE), "a.mcap", "more than 64 MiB"),
    "false chunk": (lambda file: chunk_bomb(file, 1000), "a.mcap", "damaged chunks"),
    "repeated messages": (repeated_bomb, "a.mcap", "beyond 200 times the size of the file"),
    "zeros": (zeros_bomb, "a.mcap", "skipped 1 damaged chunks"),
    "file": (file_bomb, "a.mcap.zstd", "expected at most 200 times its size"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_memory_is_bounded_whatever_is_compressed(tmp_path: Path, name: str) -> None:
    write, file, expected = BOMBS[name]
    write(tmp_path / file)
    tracemalloc.start()
    try:
        said = " ".join(read(tmp_path / file).remarks)
    except ExperienceError as error:
        said = str(error)
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert expected in said
    assert peak < MOST


END = "\n" + "=" * 80 + "\nMSG: a/"
DEFINITIONS = {
    "elements without fields": (f"a/E[] x{END}E\nint32 C=1", "at least 4 bytes for each object"),
    "elements without bytes": (f"a/E[] x{END}E\nuint8[8] y", "at least 4 bytes for each object"),
    "elements of many types": (
        "a/E0[] x" + "".join(f"{END}E{i}\na/E{i + 1} y" for i in range(99)) + f"{END}E99\nint64 y",
        "at least 4 bytes for each object",
    ),
    "large array of objects": (f"a/E[99999] x{END}E\nint32 y", "at most 1000 objects"),
    "type in itself": (f"a/E x{END}E\na/E y", "does not contain itself"),
    "empty arrays": ("uint8[0] x\nint32 y", "expected arrays with elements"),
    "many fields": ("".join(f"int8 x{i}\n" for i in range(3000)), "at most 2000 fields"),
    "large": ("# a comment\n" * 9000 + "int8 x", "at most 64 KiB"),
    "unknown type": ("a/E x", "expected a definition of a/E"),
    "terminal": ("\x1b[2Jfloat64\x1b[31m x y z", "expected a field of nav_msgs/Odometry, got"),
    "name": ("float64 X__", "invalid field name"),
}


@pytest.mark.parametrize("name", DEFINITIONS)
def test_a_message_costs_memory_in_proportion_to_its_size(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    """Definitions which could cost more are refused, once for all messages; nothing is printed."""
    text, expected = DEFINITIONS[name]
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema(ODOMETRY, "ros2msg", text.encode())
        channel = writer.register_channel("/odom", "cdr", schema)
        for number in range(2000):
            data = b"\0\1\0\0" + struct.pack("<I", 4_000_000_000) + bytes(1000)
            writer.add_message(channel, number, data, number)
        writer.finish()
    with Bag([tmp_path / "a.mcap"]) as bag:
        assert list(bag.messages(bag.topics)) == []
        (remark,) = bag.remarks()
    assert remark.startswith("skipped 2000 messages on /odom: ")
    assert expected in remark
    assert remark.isprintable()
    assert capfd.readouterr() == ("", "")


def test_definitions_may_have_comments_constants_and_defaults(tmp_path: Path) -> None:
    text = (
        "# of a robot\nint32 MOST = 5  # m\nstring<=5 NAME='a # b'\nfloat64 x 1.5\n\n"
        f"E[<=3] several\tstring<=4[2] y\n{END}E\nuint8[4] z\nbuiltin_interfaces/msg/Time t\n"
    ).replace("\t", "\n")
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema("a/msg/B", "ros2msg", text.encode())
        channel = writer.register_channel("/b", "cdr", schema)
        data = b"\0\1\0\0" + struct.pack("<dI4siI", 2.5, 1, b"abcd", 7, 8)
        data += struct.pack("<I4sI2s", 4, b"abc\0", 2, b"d\0")
        writer.add_message(channel, 1, data, 1)
        writer.finish()
    with Bag([tmp_path / "a.mcap"]) as bag:
        ((_, message),) = bag.messages(bag.topics)
    assert message.x == 2.5
    assert [(each.z, each.t.sec, each.t.nanosec) for each in message.several] == [(b"abcd", 7, 8)]
    assert message.y == ["abc", "d"]


def test_a_decompressed_file_leaves_half_of_the_free_space(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = chunked(tmp_path / "a.mcap").read_bytes()
    (tmp_path / "b.mcap.zstd").write_bytes(zstandard.ZstdCompressor().compress(content))
    usage = shutil.disk_usage(tmp_path)._replace(free=len(content))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(ExperienceError, match="half of the free space in"):
        read(tmp_path / "b.mcap.zstd")


def test_names_of_topics_may_be_no_utf_8(tmp_path: Path, usual: pd.DataFrame) -> None:
    file = in_sqlite(tmp_path)
    insert = "INSERT INTO topics SELECT {}, {}, type, {}, '', '' FROM topics LIMIT 1"
    change(
        file,
        insert.format(9, "CAST(x'2fff00fe' AS TEXT)", "'cdr'"),
        insert.format(10, "x'2fff'", "'cdr'"),
        insert.format(11, "name", "CAST(x'ff' AS TEXT)"),
    )
    pd.testing.assert_frame_equal(read(file).frame, usual)


def test_encodings_are_counted_together(tmp_path: Path) -> None:
    file = chunked(tmp_path / "a.mcap")
    with (tmp_path / "b.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema(ODOMETRY, "ros2msg", b"int32 x")
        for number in range(100):
            channel = writer.register_channel(f"/{number}", f"e{number}", schema)
            writer.add_message(channel, number, bytes(8), number)
        writer.finish()
    with Bag([file, tmp_path / "b.mcap"]) as bag:
        assert bag.remarks() == ["skipped 100 topics in another encoding than cdr"]


def test_large_messages_are_skipped_before_they_are_read(
    tmp_path: Path, usual: pd.DataFrame
) -> None:
    file = in_sqlite(tmp_path)
    row = "INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 1, zeroblob(50000000))"
    change(file, row, row.replace("(1, 1,", "(2, 2,"))
    tracemalloc.start()
    experience = read(file)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 40 * MEGABYTE
    assert experience.remarks == (f"{file.name}: skipped 2 messages of more than 4 MiB",)
    pd.testing.assert_frame_equal(experience.frame, usual)
