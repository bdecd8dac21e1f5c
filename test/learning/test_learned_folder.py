"""A learned folder with faults: records are kept, damaged files are set aside."""

import errno
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from experience_rows import synthetic_model
from stored import INFO, ROBOT, episodes, stored
from test_learner import FakeRound, made, take

from ator_ros.experience import store
from ator_ros.experience.store import STORE, read_records
from ator_ros.files import save
from ator_ros.learning.gains import GAINS, ChainGain, add_chains, read_gains
from ator_ros.learning.learner import FROZEN, KIND, ROUND, Learner
from ator_ros.learning.sets import (
    RECORDS,
    Manifest,
    current_set,
    new_set_folder,
    publish,
    read_manifest,
    repair,
    seal,
)
from ator_ros.performance.model_file import save_model

CHAIN = ChainGain(True, 0.5, 0.1)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a learned folder with every kind of file."""
    folder = tmp_path_factory.mktemp("learned")
    stored(folder / RECORDS, episodes(40, slower=1.3)).close()
    made = new_set_folder(folder)
    save_model(made / "goToPose.json", synthetic_model("goToPose", ROBOT))
    key = "default/goToPose"
    seal(made, Manifest("", "2026-01-01T00:00:00Z", {key: 40}, {key: 40}, {key: "better"}))
    place = publish(folder, made)
    add_chains(folder, read_gains(folder, read_manifest(place).digest), CHAIN)
    verdict = {"episodes": 40, "reason": "better", "kind": "scaled"}
    save(folder / ROUND, KIND, {"ends": 40, "made": "", "actions": {key: verdict}})
    return folder


@pytest.fixture
def folder(tmp_path: Path, healthy: Path) -> Path:
    return Path(shutil.copytree(healthy, tmp_path / "learned", symlinks=True))


@pytest.fixture
def learner(folder: Path) -> Iterator[Learner]:
    learner = made(folder, [])
    yield learner
    learner.close()


def write_all(learner: Learner) -> None:
    """Call `work` until no record waits; each call takes limited time, on a busy machine too."""
    for tick in range(20):
        learner.work(1.0 + tick)
        if not learner.diagnostics()["records waiting in memory"]:
            break


def count(folder: Path) -> int:
    return len(read_records(folder / RECORDS, "default"))


def replaced_by_file(folder: Path) -> None:
    folder.write_text("no folder")


def replaced_by_dangling_link(folder: Path) -> None:
    folder.symlink_to(folder.with_name("nowhere"))


@pytest.mark.parametrize(
    "replace",
    [lambda _: None, replaced_by_file, replaced_by_dangling_link, Path.mkdir],
    ids=["missing", "file", "dangling link", "empty mount point"],
)
def test_records_wait_until_the_folder_is_back(
    learner: Learner, folder: Path, replace: Callable[[Path], None]
) -> None:
    elsewhere = folder.rename(folder.with_name("elsewhere"))
    replace(folder)
    take(learner, 3)
    learner.take_chain(CHAIN)
    learner.work(0.0)
    assert "expected a folder that can be written" in learner.problem
    values = learner.diagnostics()
    assert (values["records stored"], values["records waiting in memory"]) == (40, 4)
    assert not folder.is_dir() or not any(folder.iterdir())
    if folder.is_dir():
        folder.rmdir()
    else:
        folder.unlink(missing_ok=True)
    shutil.copytree(elsewhere, folder, symlinks=True)  # with other inodes, as of another mount
    write_all(learner)
    assert (learner.problem, learner.lost, learner.stored) == ("", 0, 43)
    assert count(folder) == 43
    assert len(read_gains(folder, learner.gains.models).chains) == 2
    assert count(elsewhere) == 40


@pytest.mark.parametrize("name", [RECORDS, f"{RECORDS}/{STORE}"])
def test_a_deleted_store_is_replaced_by_a_new_one(
    learner: Learner, folder: Path, name: str
) -> None:
    deleted = folder / name
    if deleted.is_dir():
        shutil.rmtree(deleted)
    else:
        deleted.unlink()
    take(learner, 3)
    write_all(learner)
    assert (learner.fault, count(folder)) == ("", 3)
    assert "it was deleted; a new one is used" in learner.problem
    assert (learner.stored, learner.diagnostics()["records waiting in memory"]) == (43, 0)


def test_records_wait_while_the_store_cannot_be_opened(learner: Learner, folder: Path) -> None:
    file = folder / RECORDS / STORE
    file.rename(folder / "elsewhere")
    file.mkdir()
    take(learner, 3)
    learner.work(0.0)
    assert "unable to open database file" in learner.fault
    file.rmdir()
    (folder / "elsewhere").rename(file)
    learner.work(0.0)
    assert (learner.fault, learner.lost, count(folder)) == ("", 0, 43)


@pytest.mark.parametrize("number", [errno.EIO, errno.ESTALE, errno.EACCES])
def test_records_wait_while_the_file_system_has_errors(
    learner: Learner, folder: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def broken(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(Path, "stat", broken)
    take(learner, 15)
    learner.work(0.0)
    learner.diagnostics()
    assert os.strerror(number) in learner.problem
    monkeypatch.undo()
    write_all(learner)
    assert (learner.problem, count(folder)) == ("", 55)


def test_only_work_writes_records(learner: Learner, folder: Path) -> None:
    """Writing may take longer than records are apart."""
    take(learner, 3)
    assert (learner.stored, learner.diagnostics()["records waiting in memory"]) == (40, 3)
    learner.work(0.0)
    assert (learner.fault, learner.stored, count(folder)) == ("", 43, 43)


def test_the_oldest_of_more_than_1000_waiting_records_are_lost(
    learner: Learner, folder: Path
) -> None:
    folder.rename(folder.with_name("elsewhere"))
    for _ in range(1005):
        learner.take_chain(CHAIN)
    assert (learner.lost, learner.diagnostics()["records waiting in memory"]) == (5, 1000)


def test_a_folder_of_another_robot_in_its_place_is_not_used(learner: Learner, folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))
    other = store.StoreInfo("another", INFO.domain)
    store.RecordStore(folder / RECORDS, other, most=10).close()
    take(learner, 2)
    learner.work(0.0)
    assert "choose another folder" in learner.problem
    assert count(folder) == 0


def truncated(data: bytes) -> Iterator[bytes]:
    yield from (b"", data[: len(data) // 2], data[:-3])


def mutated(data: bytes) -> Iterator[bytes]:
    rng = np.random.default_rng(1)
    for share in (0.0, 0.01, 0.3):  # of the bytes, at least one
        changed = np.frombuffer(data, np.uint8).copy()
        which = rng.integers(len(changed), size=max(1, int(share * len(changed))))
        changed[which] = rng.integers(256, size=len(which))
        yield changed.tobytes()


FILES = [f"{RECORDS}/{STORE}", ROUND, GAINS, "set.manifest", "goToPose.json"]


@pytest.mark.filterwarnings("ignore:.* records are damaged")
@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("damage", [truncated, mutated])
def test_a_damaged_file_is_set_aside(
    tmp_path: Path, healthy: Path, name: str, damage: Callable[[bytes], Iterator[bytes]]
) -> None:
    place = current_set(healthy)
    assert place is not None
    relative = (place / name).relative_to(healthy) if (place / name).exists() else Path(name)
    data = (healthy / relative).read_bytes()
    for number, content in enumerate(damage(data)):
        folder = tmp_path / str(number)
        shutil.copytree(healthy, folder, symlinks=True)
        (folder / relative).write_bytes(content)
        rounds: list[FakeRound] = []
        learner = made(folder, rounds)
        before = learner.stored
        take(learner, 10)
        learner.take_chain(CHAIN)
        learner.learn_now()
        learner.work(0.0)
        rounds[0].done = True
        write_all(learner)
        learner.diagnostics()
        learner.close()
        assert (learner.fault, learner.lost) == ("", 0)
        assert learner.stored == before + 10 >= 50
        assert count(folder) >= 10
        used = current_set(folder)
        if used is not None:
            read_manifest(used)
        # SQLite takes an empty file as a new store, and does not check each byte of a row
        if STORE not in name or number == 1:
            assert list(folder.rglob("*.damaged*"))


@pytest.mark.parametrize(
    "content",
    [{"ends": "x"}, {"ends": -1}, {"actions": [1]}, {"actions": {"a": {"kind": 1}}}, {"more": 1}],
)
def test_a_round_that_does_not_fit_the_schema_is_renamed(
    folder: Path, content: dict[str, object]
) -> None:
    save(folder / ROUND, KIND, content)
    learner = made(folder, [])
    assert "renamed to round.json.damaged" in learner.problem
    assert json.loads((folder / "round.json.damaged").read_text())
    assert learner.new == 40
    learner.close()


def test_a_set_that_is_damaged_while_learning_runs_is_replaced(
    learner: Learner, folder: Path
) -> None:
    place = current_set(folder)
    assert place is not None
    (place / "goToPose.json").unlink()
    learner.learn_now()
    learner.work(0.0)
    assert f"renamed to {place.name}.damaged" in learner.problem
    assert (current_set(folder), learner.manifest) == (None, None)


@pytest.mark.parametrize(
    "target", ["../important", "{root}/important", ".", "..", "sets", "sets/x"]
)
def test_a_link_that_leads_elsewhere_is_set_aside_alone(folder: Path, target: str) -> None:
    place, important = current_set(folder), folder.with_name("important")
    assert place is not None
    important.mkdir()
    link = folder / "current"
    link.unlink()
    link.symlink_to(target.format(root=folder.parent))
    assert current_set(folder) is None
    words = f"expected a link to a set; renamed to current.damaged; {place.name} is used"
    assert words in repair(folder)
    assert current_set(folder) == place
    assert important.is_dir()


@pytest.mark.parametrize("name", ["000003_old", "000003 copy", "000003", "000009-x.damaged"])
def test_other_names_beside_the_sets_are_ignored(folder: Path, name: str) -> None:
    (folder / "sets" / name).mkdir()
    made = new_set_folder(folder)
    seal(made, Manifest("", "2026-01-01T00:00:00Z", {}, {}, {}))
    assert publish(folder, made).name.startswith("000002-")


def too_large(file: Path) -> None:
    with file.open("wb") as stream:
        stream.truncate(50_000_000)


@pytest.mark.parametrize(
    "make",
    [os.mkfifo, Path.mkdir, too_large, lambda file: file.symlink_to("/dev/zero"),
     lambda file: file.symlink_to("nowhere")],
    ids=["pipe", "folder", "too large", "device", "dangling link"],
)  # fmt: skip
def test_a_model_that_is_no_ordinary_file_damages_its_set(
    folder: Path, make: Callable[[Path], None]
) -> None:
    place = current_set(folder)
    assert place is not None
    make(place / "other.json")
    assert f"renamed to {place.name}.damaged; the models of the start are used" in repair(folder)


def test_a_store_that_is_damaged_while_learning_runs_is_replaced(
    learner: Learner, folder: Path
) -> None:
    file = folder / RECORDS / STORE
    file.write_bytes(b"\xff" * file.stat().st_size)
    take(learner, 3)
    write_all(learner)
    assert "renamed to records.damaged" in learner.problem
    assert (count(folder), learner.stored, learner.lost) == (3, 43, 0)


def test_a_damaged_set_does_not_cost_the_store(
    learner: Learner, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = folder.rename(folder.with_name("elsewhere"))
    take(learner, 3)
    shutil.copytree(elsewhere, folder, symlinks=True)
    place = current_set(folder)
    assert place is not None
    (place / "goToPose.json").unlink()
    with monkeypatch.context() as patched:  # as if it were damaged right after the repair
        patched.setattr("ator_ros.learning.learner.repair", lambda _: "")
        learner.work(0.0)
        assert "digest" in learner.fault
    write_all(learner)
    assert (learner.fault, learner.lost, count(folder)) == ("", 0, 43)
    assert not folder.joinpath("records.damaged").exists()


def test_freezing_follows_the_folder(learner: Learner, folder: Path) -> None:
    elsewhere = folder.rename(folder.with_name("elsewhere"))
    take(learner, 3)
    (elsewhere / FROZEN).touch()
    shutil.copytree(elsewhere, folder, symlinks=True)
    learner.work(0.0)
    assert learner.frozen
    assert learner.learn_now() == "learning is frozen"
