"""The command lines of collect and train, from experience to rules."""

import fcntl
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from experience_rows import synthetic_experience
from selection import few

from ator_ros.bases.description import load_robot
from ator_ros.experience.parallel import BackendError, run_tasks, workers
from ator_ros.experience.table import Experience, read_experience, write_experience
from ator_ros.tools import collect, evaluate, train
from ator_ros.tools.command_line import INTERRUPTED
from scripts import accuracy

ROBOT = load_robot()
EPISODES = 100


def table(path: Path, seed: int, **metadata: Any) -> Path:
    actions = ("goToPose", "dribbleBall")
    frames = [synthetic_experience(action, episodes=EPISODES, seed=seed) for action in actions]
    frames[0].loc[frames[0].index[frames[0]["success"]][0], "position_error"] = math.nan
    given = {"seed": seed, "robot_digest": ROBOT.digest(), "action_set": "default", **metadata}
    write_experience(path, Experience(pd.concat(frames, ignore_index=True), given))
    return path


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("learned")
    experience = table(folder / "a.parquet", 1)
    fresh = table(folder / "b.parquet", 2)
    words = [str(experience), "--fresh", str(fresh), "--models", str(folder / "models")]
    assert train.main(words) == 0
    return folder / "models"


@pytest.mark.long
def test_collect_writes_the_same_table_for_any_number_of_workers(tmp_path: Path) -> None:
    files = [tmp_path / "one.parquet", tmp_path / "two.parquet"]
    for jobs, file in enumerate(files, start=1):
        names = ["goToPose", "dribbleBall"] * jobs  # repeated names count once
        words = ["--actions", *names, "--episodes", "2", "--seed", "9"]
        assert collect.main([*words, "--jobs", str(jobs), "--out", str(file)]) == 0
    one, two = map(read_experience, files)
    pd.testing.assert_frame_equal(one.frame, two.frame, check_exact=True)
    assert one.metadata["seed"] == 9
    assert one.metadata["robot_digest"] == ROBOT.digest()
    assert one.frame.groupby("action")["episode"].nunique().to_dict() == {
        "dribbleBall": 2,
        "goToPose": 2,
    }


def test_an_invalid_cluster_is_rejected() -> None:
    expected = "cluster: expected a dask scheduler as in tcp://host:8786, got 'nowhere'"
    with pytest.raises(BackendError, match=expected), workers(2, "nowhere"):
        pass


def test_collect_keeps_finished_episodes_if_a_worker_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*args: Any, **options: Any) -> Iterator[pd.DataFrame]:
        yield synthetic_experience("goToPose", episodes=3)
        with workers(2):
            yield from run_tasks(die, [signal.SIGKILL] * 2)

    monkeypatch.setattr(collect.simulated, "collect", broken)
    file = tmp_path / "part.parquet"
    assert collect.main(["--actions", "goToPose", "--out", str(file)]) == 1
    assert file.with_suffix(".episodes.jsonl").exists()
    assert "a worker process was killed" in capsys.readouterr().err


def die(how: signal.Signals) -> None:
    """Kill this process, like the out-of-memory killer."""
    os.kill(os.getpid(), how)


@pytest.mark.long
@pytest.mark.parametrize(
    "number", few([signal.SIGINT, signal.SIGTERM, signal.SIGKILL], signal.SIGTERM)
)
def test_collect_continues_after_a_signal_with_the_same_table(
    tmp_path: Path, number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, file = tmp_path / "whole.parquet", tmp_path / "killed.parquet"
    words = ["--actions", "goToPose", "dribbleBall", "--episodes", "4", "--seed", "9", "--out"]
    with subprocess.Popen(
        [sys.executable, "-c", WATCHED, *words, str(file), "--jobs", "2"],
        start_new_session=True, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        while "4 episodes" not in process.stdout.readline():
            assert process.poll() is None
        os.killpg(process.pid, number)  # as a terminal or supervisor does
    assert process.returncode == (-number if number == signal.SIGKILL else INTERRUPTED)
    assert eventually_gone(process.pid)
    (kept,) = tmp_path.iterdir()
    lines = kept.read_bytes()
    kept.write_bytes(lines + lines[-200:-1])  # as if it was killed while writing
    assert collect.main([*words, str(file), "--jobs", "1"]) == 0
    assert re.search(
        "collect: [4-7] episodes of an earlier call are reused", capsys.readouterr().err
    )
    assert list(tmp_path.iterdir()) == [file]
    assert collect.main([*words, str(whole), "--jobs", "1"]) == 0
    one, two = map(read_experience, (whole, file))
    pd.testing.assert_frame_equal(one.frame, two.frame, check_exact=True)


@pytest.mark.parametrize(
    ("failing", "slower", "expected"),
    [
        (0, 1.0, ""),
        (2, 1.0, ""),
        (6, 1.0, "6 of 20 failed: models of durations are learned from the others"),
        (0, 10.0, "times as long as the limits of"),
    ],
)
def test_collect_says_when_drives_failed_often_or_took_long(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    failing: int,
    slower: float,
    expected: str,
) -> None:
    rows = synthetic_experience("goToPose", episodes=20)
    rows["success"] = rows["episode"] >= failing
    rows[["duration", "time_to_go"]] *= slower
    frames = [frame for _, frame in rows.groupby("episode")]
    monkeypatch.setattr(collect.simulated, "collect", lambda *_, **__: (each for each in frames))
    words = ["--actions", "goToPose", "--episodes", "20", "--out", str(tmp_path / "t.parquet")]
    assert collect.main(words) == 0
    printed = capsys.readouterr()
    assert "collect: 20 episodes of goToPose in the simulator; the first take longer" in printed.err
    assert expected in printed.out
    assert ("check the" in printed.out) == bool(expected)


def test_finished_episodes_of_other_settings_are_not_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*args: Any, **options: Any) -> Iterator[pd.DataFrame]:
        yield synthetic_experience("goToPose", episodes=1)
        raise KeyboardInterrupt

    monkeypatch.setattr(collect.simulated, "collect", interrupted)
    common = ["--actions", "goToPose", "--out", str(tmp_path / "t.parquet")]
    assert collect.main(common) == INTERRUPTED
    (kept,) = (file for file in tmp_path.iterdir() if file.suffix == ".jsonl")
    before = kept.read_bytes()
    assert collect.main([*common, "--seed", "10"]) == 1
    message = (
        "expected episodes of the same seed, robot, domain, action set and versions, got others"
    )
    assert (
        f"{kept}: {message}: choose another --out, or delete that file" in capsys.readouterr().err
    )
    assert kept.read_bytes() == before


@pytest.mark.parametrize(
    "line",
    ["[" * 100_000, "5", "{}", '{"a":1}', '{"action":[],"episode":[]}',
     '{"action":["goToPose"],"episode":["x"]}', '{"action":["goToPose"],"episode":[1,2]}',
     '{"action":["goToPose"],"episode":[1],"t":[0]}'],
)  # fmt: skip
def test_a_damaged_episode_of_an_earlier_call_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], line: str
) -> None:
    def interrupted(*_: Any, **__: Any) -> Iterator[pd.DataFrame]:
        yield synthetic_experience("goToPose", episodes=1)
        raise KeyboardInterrupt

    monkeypatch.setattr(collect.simulated, "collect", interrupted)
    words = ["--actions", "goToPose", "--out", str(tmp_path / "t.parquet")]
    assert collect.main(words) == INTERRUPTED
    with (tmp_path / "t.episodes.jsonl").open("a") as file:
        file.write(f"{line}\n")
    capsys.readouterr()
    assert collect.main(words) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"collect: {tmp_path / 't.episodes.jsonl'}: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("tool", "out", "partial"),
    [(collect, "t.parquet", "t.episodes.jsonl"), (evaluate, ".", "situations.jsonl")],
)
def test_two_commands_do_not_share_a_result(
    tool: Any, out: str, partial: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (tmp_path / partial).open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert tool.main(["--out", str(tmp_path / out)]) == 1
    assert "expected a file of its own, another command is writing it" in capsys.readouterr().err


def eventually_gone(group: int) -> bool:
    """Return whether no process of a group is left within 30 s."""
    for _ in range(300):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


WATCHED = """
import signal
import sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job would ignore Ctrl-C
from ator_ros.tools import collect

class Bar:
    def __init__(self, episodes, **options):
        self.episodes = episodes

    def __iter__(self):
        for number, frame in enumerate(self.episodes, start=1):
            yield frame
            print(f"{number} episodes", flush=True)

    def close(self):
        self.episodes.close()

collect.progress = Bar
sys.exit(collect.main(sys.argv[1:]))
"""
"""Runs `collect` and prints its progress."""


def test_train_writes_models_with_their_accuracy(learned: Path) -> None:
    names = ["dribbleBall.json", "goToPose.json"]
    assert sorted(path.name for path in learned.iterdir()) == names
    data = json.loads((learned / "goToPose.json").read_text())
    assert "accuracy" in data["trees"]
    accuracy = data["accuracy"]
    assert accuracy["seed"] == 2
    assert 0.0 < accuracy["mae_s"] < 0.2
    assert accuracy["mae_s_ci95"][0] < accuracy["mae_s"] < accuracy["mae_s_ci95"][1]
    assert accuracy["rmse_s_ci95"][0] < accuracy["rmse_s"] < accuracy["rmse_s_ci95"][1]
    assert accuracy["success"]["brier"] > 0.0
    assert data["training"]["episodes"] == EPISODES
    assert data["training"]["seed"] == 1
    assert data["robot_digest"] == ROBOT.digest()


def test_rules_are_printed_by_action_and_by_file(
    learned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert train.main(["--rules", "goToPose", "--models", str(learned)]) == 0
    by_action = capsys.readouterr().out
    assert "time = " in by_action
    assert train.main(["--rules", str(learned / "goToPose.json")]) == 0
    assert capsys.readouterr().out == by_action


@pytest.mark.long
def test_a_page_of_the_feature_ablation_is_written(learned: Path, tmp_path: Path) -> None:
    page = tmp_path / "ablation.md"
    tables = [str(learned.with_name(name)) for name in ("a.parquet", "b.parquet")]
    words = [*tables, "--out", str(page)]
    assert accuracy.main(words) == 0
    assert "| dribbleBall | the paper's 3 | " in page.read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["none.parquet"], "none.parquet: expected a Parquet file"),
        (
            ["--rules", "x.parquet"],
            "--rules: expected an action or a model, a .json file, got 'x.parquet'",
        ),
        (["--rules", "fly"], "fly.json: expected a model, there is none"),
    ],
)
def test_errors_are_one_line(
    learned: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    capsys.readouterr()
    assert train.main([*words, "--models", str(learned)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("train: ")
    assert message in error
    assert error.count("\n") == 1


def test_experience_of_another_robot_is_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    foreign = table(tmp_path / "foreign.parquet", 1, robot_digest="0123456789abcdef")
    assert train.main([str(foreign), "--models", str(tmp_path)]) == 1
    assert "metadata.robot_digest: expected" in capsys.readouterr().err
