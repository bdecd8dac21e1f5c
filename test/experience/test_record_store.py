"""The store of records: bounded, readable after a kill at any time, and a source of `train`."""

import dataclasses
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from selection import few
from stored import INFO, ROBOT, episodes, stored

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.recordings import read_sources
from ator_ros.experience.store import NUMBER, STORE, RecordStore, read_records, read_store
from ator_ros.experience.table import goal_variables_of_columns
from ator_ros.files import DamagedFileError, FileError


def durations(folder: Path) -> list[float]:
    return read_records(folder, "default")["duration"].tolist()


def test_appended_episodes_are_read(tmp_path: Path) -> None:
    made = list(episodes(5))
    stored(tmp_path, iter(made))
    rows = read_store(tmp_path).frame
    assert rows["duration"].tolist() == [episode.duration for episode in made]
    assert rows["xg"].tolist() == [episode.situation.goal.pose.x for episode in made]
    assert rows["ball_x"].tolist() == [0.5] * 5
    assert rows["heading_error"].isna().all()
    assert rows["episode"].tolist() == [0, 1, 2, 3, 4]


def test_declared_goal_variables_are_kept(tmp_path: Path) -> None:
    stored(tmp_path, episodes(3, values={"force": 2.5}), episodes(2, action="dribbleBall")).close()
    rows = read_store(tmp_path).frame
    assert rows["forceg"].tolist()[:3] == [2.5] * 3
    assert rows["forceg"].isna().tolist() == [False] * 3 + [True] * 2
    assert goal_variables_of_columns(read_store(tmp_path).frame) == ("force",)


def test_train_reads_the_store(tmp_path: Path) -> None:
    stored(tmp_path, episodes(30))
    experience = read_sources([tmp_path], ROBOT, SOCCER)
    assert len(experience.frame) == 30
    assert experience.metadata["action_set"] == "default"


def test_numbering_continues_after_the_last_episode(tmp_path: Path) -> None:
    stored(tmp_path, episodes(3)).close()
    store = stored(tmp_path, episodes(2, seed=2))
    assert store.stored == 5
    assert len(durations(tmp_path)) == 5


def test_the_oldest_episodes_are_dropped(tmp_path: Path) -> None:
    made = list(episodes(50))
    stored(tmp_path, iter(made), most=20)
    rows = read_records(tmp_path, "default")
    assert rows[NUMBER].tolist() == list(range(30, 50))
    assert rows["duration"].tolist() == [episode.duration for episode in made[30:]]


def test_episodes_are_appended_together_or_not_at_all(tmp_path: Path) -> None:
    store = stored(tmp_path, episodes(2), most=20)
    store.append("default", *episodes(30))
    assert (store.stored, len(durations(tmp_path))) == (32, 20)
    good, bad = episodes(2)
    bad = dataclasses.replace(bad, reason="\0" * (1 << 20))  # longer than a record may be
    with pytest.raises(DamagedFileError, match="too big"):
        store.append("default", good, bad)
    assert (store.stored, len(durations(tmp_path))) == (32, 20)


def test_a_damaged_store_is_refused(tmp_path: Path) -> None:
    stored(tmp_path, episodes(3)).close()
    (tmp_path / STORE).write_bytes(b"\xff" * 5000)
    for read in (lambda: RecordStore(tmp_path, INFO, most=9), lambda: read_store(tmp_path)):
        with pytest.raises(FileError, match="expected a store of records"):
            read()


ENDLESS = """
WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r)
SELECT n AS number, 'default' AS action_set, 'a' AS row FROM r
"""
PROGRAMS = {
    "view": ("DROP TABLE episodes", f"CREATE VIEW episodes AS {ENDLESS}"),
    "column": (
        "DROP TABLE episodes",
        "CREATE TABLE episodes (number INTEGER PRIMARY KEY, action_set TEXT, "
        "row AS (hex(zeroblob(100000000))))",
        "INSERT INTO episodes (action_set) VALUES ('default')",
    ),
    "large row": (
        "INSERT INTO episodes (action_set, row) VALUES ('default', zeroblob(100000000))",
    ),
}


def changed_store(folder: Path, *statements: str) -> None:
    """Make a store of three episodes, and change it by statements of SQL."""
    stored(folder, episodes(3)).close()
    with closing(sqlite3.connect(folder / STORE)) as database, database:
        for statement in statements:
            database.execute(statement)


@pytest.mark.parametrize("name", PROGRAMS)
def test_only_stored_tables_with_records_are_read(tmp_path: Path, name: str) -> None:
    changed_store(tmp_path, *PROGRAMS[name])
    with pytest.raises(FileError, match=f"{STORE}: expected a store of records: "):
        read_store(tmp_path)


@pytest.mark.parametrize(
    "program",
    [
        f"CREATE TRIGGER t AFTER INSERT ON episodes BEGIN INSERT INTO source {ENDLESS}; END",
        f"CREATE VIEW v AS {ENDLESS}",
    ],
)
def test_nothing_is_appended_to_a_store_with_programs(tmp_path: Path, program: str) -> None:
    changed_store(tmp_path, program)
    with pytest.raises(DamagedFileError, match=r"expected a store of records, got the \w+ [tv]$"):
        RecordStore(tmp_path, INFO, most=9)


def test_a_store_without_a_robot_is_refused(tmp_path: Path) -> None:
    changed_store(tmp_path, "DELETE FROM source")
    with pytest.raises(FileError, match="expected a robot and a domain, got none"):
        read_store(tmp_path)


def test_a_store_of_another_robot_is_rejected(tmp_path: Path) -> None:
    stored(tmp_path)
    with pytest.raises(FileError, match="choose another folder"):
        RecordStore(tmp_path, dataclasses.replace(INFO, robot_digest="other"), most=100)


WRITER = """
import sys, pathlib
from stored import episodes, stored
store = stored(pathlib.Path(sys.argv[1]))
for episode in episodes(10**6, seed=int(sys.argv[2])):
    store.append("default", episode)
    print(store.stored, flush=True)
"""


@pytest.mark.parametrize("kills", few([1, 4], 1))
def test_a_killed_writer_leaves_a_readable_store(tmp_path: Path, kills: int) -> None:
    here = str(Path(__file__).parents[1])
    for seed in range(kills):
        command = [sys.executable, "-c", WRITER, str(tmp_path), str(seed)]
        with subprocess.Popen(command, cwd=here, stdout=subprocess.PIPE, text=True) as process:
            process.stdout.readline()
            time.sleep(0.05 * seed)
            process.send_signal(signal.SIGKILL)
            printed = [int(line) for line in process.stdout.read().split("\n")[:-1]]
        rows = read_records(tmp_path, "default")
        assert len(rows) >= max(printed, default=0)
    assert len(rows) >= kills  # each writer was killed after its first episode


@pytest.mark.parametrize(
    "damaged",
    [
        lambda text: text[:50],
        lambda _: "[1]",
        lambda _: None,
        lambda text: text.replace('"duration"', '"durbtion"'),
        lambda text: text.replace('"x": ', '"x": "a", "w": '),
    ],
    ids=["cut off", "list", "missing", "name", "type"],
)
def test_damaged_rows_are_left_out(tmp_path: Path, damaged: Callable[[str], str | None]) -> None:
    made = list(episodes(9))
    stored(tmp_path, iter(made)).close()
    with closing(sqlite3.connect(tmp_path / STORE)) as database, database:
        for number in (3, 8):
            (text,) = database.execute(
                "SELECT row FROM episodes WHERE number = ?", [number]
            ).fetchone()
            database.execute(
                "UPDATE episodes SET row = ? WHERE number = ?", [damaged(text), number]
            )
    with pytest.warns(UserWarning, match="2 of 9 records are damaged and left out"):
        kept = durations(tmp_path)
    assert kept == [made[number].duration for number in (0, 1, 3, 4, 5, 6, 8)]


def test_reading_writes_nothing(tmp_path: Path) -> None:
    stored(tmp_path, episodes(3)).close()
    before = [(file.name, file.stat().st_mtime_ns) for file in tmp_path.iterdir()]
    assert len(durations(tmp_path)) == 3
    assert [(file.name, file.stat().st_mtime_ns) for file in tmp_path.iterdir()] == before


def test_a_folder_without_a_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is none"):
        durations(tmp_path)
    assert not any(tmp_path.iterdir())


def test_a_file_that_was_replaced_is_noticed(tmp_path: Path) -> None:
    store = stored(tmp_path / "one", episodes(3))
    assert store.is_in_place()
    stored(tmp_path / "other", episodes(3)).close()
    (tmp_path / "other" / STORE).replace(tmp_path / "one" / STORE)
    assert not store.is_in_place()
