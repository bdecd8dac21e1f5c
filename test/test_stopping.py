"""Work that is stopped, or whose disk fills: what was finished is kept, and a full disk is told before."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from experience_rows import made_up_experience

from ator_ros.evaluation import running
from ator_ros.evaluation.report import write_report
from ator_ros.evaluation.running import PARTIAL, PartialResults, results_in, run_situations
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.experience.table import join, read_experience
from ator_ros.files import reserved
from ator_ros.tools import collect, evaluate
from ator_ros.tools.guard import INTERRUPTED, ending_signals, guarded, undisturbed, until_stopped


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Yield a folder on a disk of 2 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("needs the right to mount a file system")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture
def limit_files() -> Iterator[Callable[[int], None]]:
    """Yield a function that sets how large files may become in bytes, which needs no rights."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


def fill(folder: Path) -> Path:
    """Leave no room on the disk of `folder`; return the file that takes it."""
    file = folder / "fill"
    with contextlib.suppress(OSError), file.open("wb", buffering=0) as stream:
        while stream.write(bytes(4096)):
            pass
    return file


def free_what_is_reserved(folder: Path) -> None:
    """Empty the files without a name on the disk of `folder` that this process keeps open."""
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            if folder in link.readlink().parents and link.stat().st_nlink == 0:
                os.truncate(link, 0)


def outcome(task: tuple[Settings, int]) -> Record:
    """Return what is kept of a situation, without executing it."""
    return {"index": task[1], "policies": {"naive": {"duration": 1.5}}, "note": "x" * 3000}


def at_once(function: Any, tasks: Iterable[Any], **options: Any) -> Iterator[Record]:
    return map(outcome, tasks)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_stop_a_command_as_ctrl_c_does(
    number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(number)

    def work() -> int:
        os.kill(os.getpid(), number)
        time.sleep(5.0)
        return 0

    assert guarded("tool", work, interrupted="what was done is kept") == INTERRUPTED
    assert capsys.readouterr().err == "tool: interrupted; what was done is kept\n"
    assert signal.getsignal(number) is before


def test_an_error_of_several_lines_is_reported_in_one(capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> int:
        raise OSError("expected a file\n  got none\n\n  start again")

    assert guarded("tool", work) == 1
    assert capsys.readouterr().err == "tool: expected a file; got none; start again\n"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_what_goes_on_until_it_is_stopped_ends_in_order(number: signal.Signals) -> None:
    ended = []

    def serve(going_on: Callable[[], None]) -> None:
        try:
            for _ in range(2):
                os.kill(os.getpid(), number)
            while True:
                going_on()
        finally:
            ended.append(number)

    assert until_stopped("view", serve, ()) == 0
    assert ended == [number]


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert ending_signals() == (signal.SIGINT, signal.SIGTERM)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_second_signal_does_not_disturb_the_writing() -> None:
    def work() -> int:
        with undisturbed():
            for number in (signal.SIGINT, signal.SIGTERM):
                os.kill(os.getpid(), number)
        return 7

    assert guarded("tool", work) == 7


def test_room_is_kept_and_given_back(small_disk: Path) -> None:
    with reserved(small_disk / "new", 1_500_000) as release:
        assert fill(small_disk).stat().st_size < 600_000
        release()
        (small_disk / "result").write_bytes(bytes(1_400_000))
    assert sorted(path.name for path in small_disk.rglob("*")) == ["fill", "new", "result"]


def test_of_a_killed_process_no_reserved_room_remains(tmp_path: Path) -> None:
    program = (
        "import os, sys; from ator_ros.files import reserved\n"
        "with reserved(sys.argv[1], 1_000_000): os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["disk", "file"])
def test_no_room_is_told_in_one_line(place: str, small_disk: Path) -> None:
    (small_disk / "file").touch()
    folder, told = {
        "disk": (small_disk, r"disk: expected room for 3.0 MB of results: No space left on device"),
        "file": (small_disk / "file", r"file: expected a folder that can be written: File exists"),
    }[place]
    with pytest.raises(OSError, match=told), reserved(folder, 3_000_000):
        pass
    assert [path.name for path in small_disk.iterdir()] == ["file"]


def test_a_full_disk_is_told_before_the_situations_are_executed(
    small_disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def begin(*_: Any, **__: Any) -> Iterator[Record]:
        yield pytest.fail("it began")

    monkeypatch.setattr(running, "run_tasks", begin)
    with pytest.raises(OSError, match=r"expected room for 10.5 MB of results"):
        run_situations(Settings(seed=1), situations=1000, folder=small_disk)


def test_a_place_without_room_gets_no_folder(limit_files: Callable[[int], None], tmp_path: Path) -> None:
    limit_files(100_000)
    folder = tmp_path / "new" / "results"
    with pytest.raises(OSError, match="expected room for"), results_in(folder, situations=5):
        pytest.fail("it began")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_fills_loses_no_situation(small_disk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = Settings(seed=1)

    def filling(*args: Any, **options: Any) -> Iterator[Record]:
        for record in at_once(*args, **options):
            if record["index"] == 2:
                fill(small_disk)
            yield record

    monkeypatch.setattr(running, "run_tasks", filling)
    with pytest.raises(
        EvaluationError, match=r"No space left on device; [34] of 5 situations are kept"
    ) as told:
        run_situations(settings, situations=5, folder=small_disk)
    assert "\n" not in str(told.value)
    (small_disk / "fill").unlink()
    monkeypatch.setattr(running, "run_tasks", at_once)
    kept = PartialResults(small_disk, settings, settings.source.digest(settings.policies, settings.chain))
    assert list(kept.records) in ([0, 1, 2], [0, 1, 2, 3])
    records = run_situations(settings, situations=5, folder=small_disk)
    assert records == [outcome((settings, index)) for index in range(5)]


def test_room_that_is_missing_is_named(limit_files: Callable[[int], None], tmp_path: Path) -> None:
    limit_files(1_000_000)
    with (
        pytest.raises(OSError, match=r"expected room for 3.0 MB of results: File too large"),
        reserved(tmp_path, 3_000_000),
    ):
        pass
    assert not list(tmp_path.iterdir())


def test_a_write_that_fails_loses_no_situation(
    limit_files: Callable[[int], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(seed=1)

    def limiting(*args: Any, **options: Any) -> Iterator[Record]:
        for record in at_once(*args, **options):
            if record["index"] == 2:
                limit_files((tmp_path / PARTIAL).stat().st_size + 1000)
            yield record

    monkeypatch.setattr(running, "run_tasks", limiting)
    with pytest.raises(EvaluationError, match=r"File too large; 2 of 5 situations are kept"):
        run_situations(settings, situations=5, folder=tmp_path)
    limit_files(resource.RLIM_INFINITY)
    monkeypatch.setattr(running, "run_tasks", at_once)
    kept = PartialResults(tmp_path, settings, settings.source.digest(settings.policies, settings.chain))
    assert list(kept.records) == [0, 1]
    records = run_situations(settings, situations=5, folder=tmp_path)
    assert records == [outcome((settings, index)) for index in range(5)]


def test_two_evaluations_do_not_share_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first takes away the partial results at its very end, to which the other one would append."""
    words = ["--situations", "2", "--seed", "1", "--policies", "naive", "--oracle", "0", "--jobs", "1"]
    codes = []

    def report(*args: Any) -> Path:
        codes.append(evaluate.main([*words, "--out", str(tmp_path)]))
        return write_report(*args)

    monkeypatch.setattr(evaluate, "write_report", report)
    assert evaluate.main([*words, "--out", str(tmp_path)]) == 0
    assert codes == [1]
    assert "another command is writing there" in capsys.readouterr().err
    with results_in(tmp_path, 2):
        pass


def test_collect_keeps_its_table_elsewhere_when_the_disk_fills(
    small_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def filling(*args: Any, **options: Any) -> Iterator[Any]:
        yield made_up_experience("goToPose", episodes=3)
        free_what_is_reserved(small_disk)
        fill(small_disk)

    monkeypatch.setattr(collect.simulated, "collect", filling)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    file = small_disk / "table.parquet"
    assert collect.main(["--actions", "goToPose", "--episodes", "3", "--out", str(file)]) == 1
    (kept,) = tmp_path.glob("ator_ros-*/table.parquet")
    assert read_experience(kept).frame["episode"].nunique() == 3
    assert str(kept) in capsys.readouterr().out
    assert not file.exists()


def test_a_second_signal_while_the_table_is_joined_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*args: Any, **options: Any) -> Iterator[Any]:
        yield made_up_experience("goToPose", episodes=3)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5.0)

    def joined(frames: Any) -> Any:
        os.kill(os.getpid(), signal.SIGTERM)
        return join(frames)

    monkeypatch.setattr(collect.simulated, "collect", stopped)
    monkeypatch.setattr(collect, "join", joined)
    file = tmp_path / "table.parquet"
    words = ["--actions", "goToPose", "--episodes", "9", "--out", str(file)]
    assert collect.main(words) == INTERRUPTED
    assert read_experience(file).frame["episode"].nunique() == 3
