"""Reports of the nodes about the robot's description and the performance models."""

import errno
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from conftest import Host
from diagnostic_msgs.msg import DiagnosticStatus
from maps import hall_map
from process import PATIENCE, environment
from ros_client import Client, values_of
from selection import few

from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.learning.gains import GAINS, ChainGain, add_chains, read_gains
from ator_ros.learning.sets import Manifest, new_set_folder, publish, read_manifest, seal
from ator_ros.nodes import models as nodes_models
from ator_ros.resources import resource_path

BOTH = pytest.mark.parametrize("name", ["executor", "refinement"])


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """Return a folder with only the shipped models of the default action set."""
    folder = tmp_path / "models"
    folder.mkdir()
    for file in Path(resource_path("models")).glob("*.json"):
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


@BOTH
def test_an_action_set_without_models_is_no_error(
    host: Host, client: Client, models: Path, name
) -> None:
    node = host(name, models=models)
    status = client.status_of(name)
    values = values_of(status)
    assert values["models of default"] == "dribbleBall, goToPose, shoot"
    assert values["models of bezier"].startswith("path times of goToPose, dribbleBall")
    assert status.message.startswith(
        {"executor": "odom is missing; no node pub", "refinement": "running"}[name]
    )
    assert "bezier" not in node.output  # this action set was not requested
    assert f"models in {models}: dribbleBall, goToPose, shoot" in node.output
    assert "[WARN]" not in node.output


@BOTH
def test_a_default_set_without_models_is_named_beside_sets_that_have_some(
    host: Host, models: Path, name: str
) -> None:
    (models / "bezier").mkdir()
    for file in Path(resource_path("models"), "bezier").glob("*.json"):
        (models / "bezier" / file.name).write_bytes(file.read_bytes())
    for file in models.glob("*.json"):
        file.unlink()
    output = host(name, models=models).output
    assert "path times of goToPose" in output
    assert f"; models in {models} of action set bezier: " in output


@BOTH
def test_a_damaged_model_is_an_error(host: Host, client: Client, models: Path, name: str) -> None:
    (models / "bezier").mkdir()
    text = (models / "goToPose.json").read_text(encoding="utf-8")
    (models / "bezier" / "goToPose.json").write_text(text[: len(text) // 2], encoding="utf-8")
    (models / "shoot.json").write_text(text.replace('"goToPose"', '"shoot"', 1), encoding="utf-8")
    node = host(name, models=models)
    status = client.status_of(name)
    assert status.level == DiagnosticStatus.WARN
    assert "action set bezier: " in status.message
    assert "goToPose.json: expected a readable JSON file" in status.message
    assert "[WARN]" in node.output


@BOTH
def test_a_missing_folder_of_models_is_a_warning(host: Host, tmp_path: Path, name: str) -> None:
    assert "nowhere" in host(name, models=tmp_path / "nowhere").output.partition("[WARN]")[2]


@pytest.fixture
def slow_robot(tmp_path: Path) -> Path:
    text = Path(resource_path("config", "pioneer.yaml")).read_text(encoding="utf-8")
    assert text.count("v: 1.2 ") == 1
    file = tmp_path / "slow.yaml"
    file.write_text(text.replace("v: 1.2 ", "v: 1.1 "), encoding="utf-8")
    return file


@BOTH
def test_a_given_robot_file_is_used(
    host: Host, client: Client, slow_robot: Path, name: str
) -> None:
    node = host(name, robot=slow_robot)
    status = client.status_of(name)
    assert status.level == DiagnosticStatus.WARN
    assert "dribbleBall was learned with ANOTHER ROBOT" in status.message
    assert "ANOTHER ROBOT" in node.output


@pytest.fixture
def learned(tmp_path: Path, models: Path) -> Path:
    """Return a learned folder with a set in use and a chain that was measured with it."""
    folder = tmp_path / "learned"
    made = new_set_folder(folder)
    for file in models.iterdir():
        (made / file.name).write_bytes(file.read_bytes())
    seal(made, Manifest("", "2026-01-01T00:00:00Z", {}, {}, {}))
    digest = read_manifest(publish(folder, made)).digest
    add_chains(folder, read_gains(folder, digest), ChainGain(True, 0.5, 0.1))
    return folder


def test_a_learned_set_waits_for_a_map_that_comes_from_a_topic(
    client: Client, learned: Path, models: Path
) -> None:
    settings = {"models": str(models), "learned": str(learned), "map": "map"}
    libraries = {"default": SOCCER.library(load_robot())}
    sets = nodes_models.LearnedSets(client.node, SOCCER, libraries, settings)
    assert sets.diagnostics()["learned set"] == "none yet"
    assert not sets.problem
    mapped = SOCCER.on_map(hall_map())
    sets.load(mapped, {"default": mapped.library(mapped.robot())})
    assert sets.diagnostics()["learned set"] != "none yet"


def test_models_of_the_start_are_used_on_new_maps_while_the_learned_folder_has_a_fault(
    client: Client, learned: Path, models: Path
) -> None:
    libraries = {"default": SOCCER.library(load_robot())}
    settings = {"models": str(models), "learned": str(learned)}
    sets = nodes_models.LearnedSets(client.node, SOCCER, libraries, settings)
    in_use = sets.diagnostics()["learned set"]
    elsewhere = learned.with_name("elsewhere")
    learned.rename(elsewhere)
    for _ in range(2):
        sets.load(SOCCER, libraries)
        assert set(sets.present["default"].models) == {"dribbleBall", "goToPose", "shoot"}
        assert (
            "expected a set in use, it has disappeared; those of `models` are used" in sets.problem
        )
    elsewhere.rename(learned)
    client.eventually(
        lambda: sets.diagnostics()["learned set"] == in_use and not sets.problem, "the learned set"
    )


def test_a_share_that_hangs_delays_a_new_map_by_two_seconds(
    client: Client, learned: Path, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    libraries = {"default": SOCCER.library(load_robot())}
    settings = {"models": str(models), "learned": str(learned)}
    sets = nodes_models.LearnedSets(client.node, SOCCER, libraries, settings)
    ending = threading.Event()
    exists = Path.exists

    def hang(path: Path) -> bool:
        return ending.wait(PATIENCE) if path == learned else exists(path)

    monkeypatch.setattr(Path, "exists", hang)
    began = time.monotonic()
    sets.load(SOCCER, libraries)
    took = time.monotonic() - began
    ending.set()
    assert took < 0.5 * PATIENCE
    assert set(sets.present["default"].models) == {"dribbleBall", "goToPose", "shoot"}
    assert "expected an answer of the file system" in sets.problem


HANGING = """
import os, signal, sys, time
from ator_ros.nodes import models, refinement

def hang(folder):
    if calls.pop():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1000.0)

calls = [True, False]  # the folder can be read at the start
models.current_set = hang
refinement.main()
"""


@pytest.mark.long
def test_a_share_that_hangs_does_not_delay_the_end_of_a_node(tmp_path: Path, domain: int) -> None:
    arguments = ["--ros-args", "-p", f"learned:={tmp_path}"]
    ended = subprocess.run(
        [sys.executable, "-c", HANGING, *arguments],
        env=environment(domain), timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert ended.returncode == 0


@pytest.mark.parametrize("fault", few(["missing", "file", "stale", "gains"], "file"))
def test_models_in_use_are_kept_while_the_learned_folder_has_a_fault(
    host: Host,
    client: Client,
    learned: Path,
    monkeypatch: pytest.MonkeyPatch,
    fault: str,
) -> None:
    node = host("refinement", learned=learned)
    status = client.status_of("refinement")
    before = values_of(status)
    assert status.message == "running"
    elsewhere, text = learned.with_name("elsewhere"), (learned / GAINS).read_text(encoding="utf-8")
    if fault in ("missing", "file"):
        learned.rename(elsewhere)
    if fault == "file":
        learned.write_text("no folder")
    elif fault == "gains":
        (learned / GAINS).write_text(text[:-9], encoding="utf-8")
    elif fault == "stale":

        def stale(_: Path) -> None:
            raise OSError(errno.ESTALE, os.strerror(errno.ESTALE))

        monkeypatch.setattr(nodes_models, "current_set", stale)
    status = client.eventually(
        lambda: next(
            (each for each in [client.status_of("refinement")] if each.message != "running"), None
        ),
        "a warning",
    )
    assert status.level == DiagnosticStatus.WARN
    assert "learned" in status.message
    assert values_of(status) == before
    monkeypatch.undo()
    if fault == "file":
        learned.unlink()
    if elsewhere.exists():
        elsewhere.rename(learned)
    (learned / GAINS).write_text(text, encoding="utf-8")
    client.eventually(
        lambda: client.status_of("refinement").message == "running", "the end of the fault"
    )
    assert values_of(client.status_of("refinement")) == before
    assert node.running
