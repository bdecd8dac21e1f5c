"""The domain `tour` over ROS: its server drives, and a drive takes as long as without ROS."""

from __future__ import annotations

import dataclasses
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
import pandas as pd
import pytest
from ament_index_python.packages import get_package_prefix

from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.domains.domain import find_domain
from ator_ros.experience.collect import FinishedEpisodes, collect
from ator_ros.experience.episode import run_episode
from ator_ros.experience.table import episode_frame, join, library_versions, read_experience
from ator_ros.simulation.simulation import Simulation
from ator_ros.tools import collect as collect_tool
from ator_ros.tools.command_line import NodesError, settled
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


def finished_of(table: Path, words: Sequence[str]) -> FinishedEpisodes:
    """Return the finished episodes of a collection that was killed."""
    options, _ = settled(collect_tool.arguments(), words)
    identity = {
        "seed": options.seed,
        "robot": TOUR.robot().sections(),
        "domain": "tour",
        "action_set": options.action_set,
        "over_ros": True,
        "versions": library_versions(),
    }
    return FinishedEpisodes(table, identity)


def test_drives_are_kept_until_the_table_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = tmp_path / "drives.parquet"
    words = ["--domain", "tour", "--actions", "drive_to", "--over-ros", "--episodes", "2"]
    words += ["--seed", str(SEED), "--out", str(table)]
    kept = finished_of(table, words)
    for frame in collect(TOUR.actions().values(), TOUR.tops, TOUR.robot(), objects=(), episodes=2, seed=SEED):
        kept.add(frame.head(1))
    kept.close()

    def fail(*_: object) -> None:
        raise OSError("no space left")

    with monkeypatch.context() as patched:
        patched.setattr(collect_tool, "write_experience", fail)
        assert collect_tool.main(words) == 1
    assert kept.path.exists()
    assert collect_tool.main(words) == 0  # starts no node
    assert list(tmp_path.iterdir()) == [table]
    frame = read_experience(table).frame
    pd.testing.assert_frame_equal(frame, join(kept.frames.values()), check_exact=True, check_dtype=False)


def test_nodes_that_do_not_do_what_is_expected_are_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def without_servers(*_: object, **__: object) -> Iterator[NoReturn]:
        raise NodesError("expected the action servers, got none")
        yield

    monkeypatch.setattr("ator_ros.tools.own_nodes.drives", without_servers)
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
    first = FinishedEpisodes(tmp_path / "drives.parquet", {})
    first.add(episode_frame(0, episode, domain.objects))
    first.close()
    (frame,) = FinishedEpisodes(tmp_path / "drives.parquet", {}).frames.values()
    assert set(frame["liftg"]) == {0.3}
    pd.testing.assert_frame_equal(frame, episode_frame(0, episode, domain.objects), check_exact=True)
