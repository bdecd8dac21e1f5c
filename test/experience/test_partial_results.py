"""Partial results of a computation, and its tasks in several processes."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from ator_ros.experience.json_lines import PartialResults
from ator_ros.experience.parallel import BackendError, progress, run_tasks, workers
from ator_ros.experience.simulated import episode_generator
from ator_ros.files import FileError

EXPECTED = "squares of the same seed"


def opened(file: Path, **identity: Any) -> PartialResults:
    return PartialResults(file, {"seed": 1, **identity}, EXPECTED)


def test_an_interrupted_computation_is_resumed(tmp_path: Path) -> None:
    file = tmp_path / "new" / "results.jsonl"
    with opened(file) as partial:
        assert partial.results == []
        partial.append({"n": 1, "square": [1, 2]})
        partial.append({"n": 2})
    with file.open("ab") as stream:
        stream.write(b'{"n": 3, "cut')
    with opened(file) as partial:
        assert partial.results == [{"n": 1, "square": [1, 2]}, {"n": 2}]
        partial.append({"n": 3})
    assert file.read_text().splitlines() == [
        '{"seed":1}',
        '{"n":1,"square":[1,2]}',
        '{"n":2}',
        '{"n":3}',
    ]


def test_a_file_without_results_is_removed(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    for _ in range(2):
        with opened(file):
            assert file.exists()
        assert not file.exists()
    with opened(file) as partial:
        partial.append({})
    with opened(file):
        pass
    assert file.exists()


def test_results_of_other_settings_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    with opened(file, of=(1, 2)) as partial:
        partial.append({"n": 1})
    with opened(file, of=[1, 2]) as partial:
        assert len(partial.results) == 1
    with pytest.raises(FileError, match=f"expected {EXPECTED}, got others: choose another --out"):
        opened(file, of=[2, 1])


@pytest.mark.parametrize("line", ["nothing", "5", "[1]"])
def test_a_damaged_file_is_refused(tmp_path: Path, line: str) -> None:
    file = tmp_path / "results.jsonl"
    file.write_text(f'{{"seed":1}}\n{line}\n')
    with pytest.raises(FileError, match=f"expected {EXPECTED}, one a line"):
        opened(file)


def test_a_file_is_written_by_one_command_at_a_time(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    with opened(file), pytest.raises(FileError, match="another command is writing it"):
        opened(file)


def square(number: int) -> int:
    return number * number


def process_of(_: int) -> int:
    return os.getpid()


def ends_its_process(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_results_are_in_the_order_of_the_tasks() -> None:
    numbers = [5, 1, 4, 2]
    assert list(run_tasks(square, numbers)) == [25, 1, 16, 4]
    assert set(run_tasks(process_of, numbers)) == {os.getpid()}
    with workers(2):
        assert list(run_tasks(square, numbers)) == [25, 1, 16, 4]
        assert os.getpid() not in set(run_tasks(process_of, numbers))


def test_a_killed_worker_is_reported() -> None:
    with workers(2), pytest.raises(BackendError, match="a worker process was killed"):
        list(run_tasks(ends_its_process, range(6)))


def test_an_address_without_a_scheduler_is_reported() -> None:
    with pytest.raises(BackendError, match="expected a dask scheduler"), workers(2, "nowhere"):
        pass


def test_progress_yields_every_result(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress(iter(()), done=3, total=3, unit="episode")) == []
    assert capsys.readouterr().err == ""
    assert list(progress(iter("abc"), done=1, total=4, unit="episode")) == ["a", "b", "c"]


def test_the_generator_of_an_episode_depends_on_action_seed_and_number_only() -> None:
    def drawn(action: str, seed: int, number: int) -> float:
        return float(episode_generator(action, seed, number).random())

    assert drawn("dock", 1, 2) == drawn("dock", 1, 2)
    others = {drawn("dock", 1, 2), drawn("dock", 1, 3), drawn("dock", 2, 2), drawn("visit", 1, 2)}
    assert len(others) == 4
