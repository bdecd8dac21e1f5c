"""The domain `tour` over ROS: its server drives, and a drive takes as long as without ROS."""

from __future__ import annotations

import argparse
import dataclasses
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix

from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.domains.domain import find_domain
from ator_ros.experience.collect import collect
from ator_ros.experience.episode import run_episode
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.table import episode_frame, read_experience
from ator_ros.simulation.simulation import Simulation
from ator_ros.tools import collect as collect_tool
from ator_ros.tools.command_line import settled
from ator_ros.tools.work import collect as collecting
from ator_ros.tools.work import collect_over_ros
from ator_ros.tools.work.collect_over_ros import Finished, drives
from ator_ros.tools.work.demo_client import DemoError
from ator_ros.tops.outcome import top_of

BIN = Path(get_package_prefix("ator_ros"), "lib", "ator_ros")
TOUR = find_domain("tour")
PATIENCE = 240.0
SEED = 7


def run(*words: object, patience: float = PATIENCE) -> subprocess.CompletedProcess[str]:
    command = list(map(str, words))
    return subprocess.run(command, capture_output=True, text=True, timeout=patience, check=False)


@pytest.mark.node
@pytest.mark.long
def test_drives_over_ros_take_as_long_as_those_without(tmp_path: Path) -> None:
    file, drives = tmp_path / "drives.parquet", 3
    ended = run(
        *(BIN / "collect", "--domain", "tour", "--over-ros", "--episodes", drives),
        *("--seed", SEED, "--out", file),
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert not file.with_suffix(".drives.jsonl").exists()
    table = read_experience(file)
    assert table.metadata["domain"] == "tour"
    assert list(table.frame["reason"]) == ["drive_to succeeded"] * drives
    simulated = collect(
        TOUR.actions().values(), TOUR.tops, TOUR.robot(), objects=(), episodes=drives, seed=SEED
    )
    for (_, driven), frame in zip(table.frame.iterrows(), simulated, strict=True):
        alone = frame.iloc[0]
        assert tuple(driven[["xg", "yg", "yawg"]]) == pytest.approx(tuple(alone[["xg", "yg", "yawg"]]))
        assert tuple(driven[["x", "y", "yaw"]]) == pytest.approx(tuple(alone[["x", "y", "yaw"]]), abs=1e-3)
        assert driven["duration"] == pytest.approx(alone["duration"], rel=0.03)


@pytest.mark.node
@pytest.mark.long
def test_the_demo_plays_a_tour(tmp_path: Path) -> None:
    ended = run(BIN / "demo", "--domain", "tour", "--situations", 1, "--out", tmp_path / "tour.png")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "three nodes, drive_to_server start on ROS domain" in ended.stdout
    assert "1 of 1 situations succeeded both ways; refinement saved" in ended.stdout


# What is finished is not driven again


def finished(table: Path, seed: int = SEED) -> Finished:
    return Finished(table, {"seed": seed, "domain": "tour"})


def test_finished_drives_are_kept_and_come_first(tmp_path: Path) -> None:
    file = tmp_path / "drives.parquet"
    frames = list(
        collect(TOUR.actions().values(), TOUR.tops, TOUR.robot(), objects=(), episodes=2, seed=SEED)
    )
    first = finished(file)
    for frame in frames:
        first.add(frame)
    with first.path.open("a", encoding="utf-8") as text:
        text.write('{"action": "drive_to", "epi')  # as by a power failure
    options = argparse.Namespace(actions=["drive_to"], episodes=2)
    again = list(drives(options, TOUR, TOUR.robot(), finished(file)))  # starts no node
    assert [frame.iloc[0].to_dict() for frame in again] == [frame.iloc[0].to_dict() for frame in frames]
    Finished.remove(file)
    assert list(tmp_path.iterdir()) == []


def test_drives_are_kept_until_the_table_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = tmp_path / "drives.parquet"
    words = ["--domain", "tour", "--actions", "drive_to", "--over-ros", "--episodes", "1"]
    words += ["--seed", str(SEED), "--out", str(table)]
    options, domain = settled(collect_tool.arguments(), words)
    identity = {"seed": SEED, "robot_digest": TOUR.robot().digest(), "domain": "tour"}
    kept = Finished(table, {**identity, "action_set": options.action_set})
    for frame in collect(TOUR.actions().values(), TOUR.tops, TOUR.robot(), objects=(), episodes=1, seed=SEED):
        kept.add(frame)

    def fail(*_: object) -> None:
        raise OSError("no space left")

    with monkeypatch.context() as patched:
        patched.setattr(collecting, "write_experience", fail)
        with pytest.raises(OSError, match="no space left"):
            collecting.run(options, domain, "collect of a test")
    assert kept.path.exists()
    assert collecting.run(options, domain, "collect of a test") == 0
    assert not kept.path.exists()
    assert len(read_experience(table).frame) == 1


def test_nodes_that_do_not_do_what_is_expected_are_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def without_servers(*_: object) -> Iterator[NoReturn]:
        raise DemoError("expected the action servers, got none")
        yield

    monkeypatch.setattr(collect_over_ros, "drives", without_servers)
    words = ["--domain", "tour", "--over-ros", "--episodes", "1", "--out", str(tmp_path / "drives.parquet")]
    assert collect_tool.main(words) == 1
    assert capsys.readouterr().err == "collect: expected the action servers, got none\n"
    assert list(tmp_path.iterdir()) == []


def test_finished_drives_keep_the_values_of_declared_goal_variables(tmp_path: Path) -> None:
    spec = dataclasses.replace(TOUR.actions()["drive_to"], goal_variables=(GoalVariable("lift", "m", 0, 1),))
    domain = dataclasses.replace(TOUR, action_sets={"default": (spec,)})
    rng = np.random.default_rng(SEED)
    sampled = spec.sample(domain.robot(), rng)
    situation = dataclasses.replace(sampled, goal=dataclasses.replace(sampled.goal, values={"lift": 0.3}))
    with Simulation(domain.robot()) as simulation:
        top = top_of(situation, domain.tops, domain.robot())
        episode = run_episode(simulation, spec.factory(domain.robot()), situation, top=top)
    first = finished(tmp_path / "drives.parquet")
    first.add(episode_frame(0, episode, domain.objects))
    options = argparse.Namespace(actions=["drive_to"], episodes=1)
    (frame,) = drives(options, domain, domain.robot(), first)
    assert list(frame["liftg"]) == [0.3]


@pytest.mark.parametrize("line", ["{}", "[1]", '{"action": "drive_to", "episode": [0]}', "3"])
def test_lines_that_are_no_drives_are_refused(tmp_path: Path, line: str) -> None:
    file = tmp_path / "drives.parquet"
    with finished(file).path.open("a", encoding="utf-8") as text:
        text.write(f"{line}\n")
    with pytest.raises(ExperienceError, match=r"drives\.drives\.jsonl: expected drives, one a line"):
        finished(file)


def test_drives_of_another_seed_are_not_gone_on_with(tmp_path: Path) -> None:
    file = tmp_path / "drives.parquet"
    finished(file)
    with pytest.raises(ExperienceError, match=r"drives.drives.jsonl: expected drives of the same seed"):
        finished(file, seed=SEED + 1)
