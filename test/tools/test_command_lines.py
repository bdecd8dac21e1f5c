"""Command lines end with a one-line error that states what was expected, also after signals."""

import argparse
import importlib
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest
from documentation import ROOT
from domain_files import CHAIN, PLACE, TOUR, file_of
from maps import hall_map

from ator_ros.domains.domain import Domain
from ator_ros.nodes import nav2_setup
from ator_ros.tools import train
from ator_ros.tools.command_line import INTERRUPTED, add_nav2, add_setting, guarded, run_tool
from ator_ros_examples.nav2_stand_in import PARAMETERS

BARE = """
name: bare
tops:
  - name: visit
    action: fly_to
    post: [{variable: robot.x, target: goal.x, tolerance: 0.25}]
actions: []
"""
NUMBER = "argument --{}: expected a whole number from "
NO_FILE = "argument --{}: expected a file that can be written, got "
NOT_INSTALLED = "domain: expected an entry point of ator_ros.domains, one of ["
NONE_THERE = "argument --domain: expected one with names for --{}, got bare, which has none"
NAMESPACE = "expected a namespace of letters"
REFUSED = [
    *(
        (f"collect --episodes={text}", NUMBER.format("episodes"))
        for text in (-1, 1.5, "1_000", 400 * "9")
    ),
    ("evaluate --oracle=1.5", NUMBER.format("oracle")),
    (
        "evaluate --oracle=3 --oracle-from=.",
        "argument --oracle-from: not allowed with argument --oracle",
    ),
    (
        "evaluate --oracle-speeds 0.1",
        "--oracle-speeds, --oracle-margin: expected --oracle, too",
    ),
    ("demo --situations=-1", NUMBER.format("situations")),
    *(("view --attach --robots " + name, NAMESPACE) for name in ("a-b", "../x")),
    *(
        ("collect --out=" + place, NO_FILE.format("out"))
        for place in (".", "file/result", "file/a/result", 300 * "x", f"{300 * 'x'}/b")
    ),
    ("demo --out=file/result", NO_FILE.format("out")),
    *((f"{command} --domain=chess", NOT_INSTALLED) for command in ("collect", "evaluate", "train")),
    ("collect --domain=bare.yaml", NONE_THERE.format("actions")),
    *((f"{name} --domain=bare.yaml", NONE_THERE.format("chain")) for name in ("demo", "evaluate")),
    (
        "collect --action-set chess",
        "argument --action-set: expected one of default, bezier, got 'chess'",
    ),
    (
        "evaluate --chain chess",
        "--chain: expected one of dribble, drive, rolling, shoot, got 'chess'",
    ),
]


@pytest.mark.parametrize(("line", "message"), REFUSED)
def test_invalid_arguments_are_rejected_before_the_work(
    line: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    (tmp_path / "bare.yaml").write_text(BARE)
    command, *words = line.split()
    if command in ("demo", "view"):  # they start nodes
        pytest.importorskip("rclpy")
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(f"ator_ros.tools.{command}").main(words)
    assert ended.value.code == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"{command}: error: ")
    assert message in error
    assert {file.name for file in tmp_path.iterdir()} == {"file", "bare.yaml"}


NODES = ("simulation", "executor", "refinement", "learning", "goal_pose", "waypoints")
HELP = """
import importlib, sys
for module in sys.argv[1:]:
    try:
        importlib.import_module(module).main([module, "--help"])
    except SystemExit as ended:
        assert ended.code == 0
assert not [name for name in ("sklearn", "pybullet") if name in sys.modules], "imported"
"""


def test_help_of_nodes_is_printed_without_heavy_imports() -> None:
    pytest.importorskip("rclpy")
    modules = [f"ator_ros.nodes.{name}" for name in NODES]
    command = [sys.executable, "-c", HELP, *modules]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.stderr, done.returncode) == ("", 0)
    assert done.stdout.count("usage: ") == len(modules)


def test_a_first_start_prints_that_it_compiles_and_an_error_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    raw = io.BytesIO()  # a terminal with PYTHONIOENCODING=ascii
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(raw, "ascii", write_through=True))
    assert train.main(["böse.parquet"]) == 1
    first, error = raw.getvalue().decode("ascii").splitlines()
    assert first == "train: the first start compiles code, which may take a minute"
    assert error.startswith("train: b\\xf6se.parquet: expected a Parquet file")


@pytest.mark.parametrize("command", ["collect", "evaluate", "study"])
def test_actions_without_a_stand_in_are_rejected(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    action = TOUR["actions"][0] | {"drives": {"start": [PLACE], "goal": [PLACE]}}
    file = file_of(
        tmp_path, {**TOUR, "tops": TOUR["tops"][:1], "actions": [action], "chains": [CHAIN]}
    )
    words = ["--domain", str(file), "--out", str(tmp_path / "result.parquet")]
    assert importlib.import_module(f"ator_ros.tools.{command}").main(words) == 1
    assert "has no `stand_in`, so only `collect --over-ros`" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [file]


DAMAGED = [
    ("train odd.parquet --models out", "odd.parquet"),
    ("train odd.mcap --models out", "odd.mcap"),
    ("train --rules odd.json", "odd.json"),
    ("train bag --models out", "bag/metadata.yaml"),
    ("train store --models out", "store/records.db"),
    *(
        (f"{tool} --robot odd.yaml --out out", "odd.yaml")
        for tool in ("evaluate", "calibrate", "study")
    ),
    ("collect --robot odd.yaml --out out.parquet", "odd.yaml"),
    ("view --robot odd.yaml", "odd.yaml"),
    ("collect --domain odd.yaml --out out.parquet", "odd.yaml"),
    *((f"{tool} --domain odd.yaml", "odd.yaml") for tool in ("plan", "demo")),
    ("evaluate --models models --out out", "models/goToPose.json"),
    ("plan ball_in_goal --object ball 1 0 --models models", "models/goToPose.json"),
]
CONTENTS = [
    bytes(range(256)) * 40,
    b"",
    b'{"format": "ator_ros boat", "schema_version": 1}',
    b"- !!python/name:os",
]


@pytest.mark.parametrize(("line", "name"), DAMAGED)
def test_a_damaged_file_ends_a_command_with_a_short_message(
    line: str,
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    command, *words = line.split()
    for content in CONTENTS:
        file.write_bytes(content)
        try:
            code = importlib.import_module(f"ator_ros.tools.{command}").main(words)
        except SystemExit as ended:
            code = ended.code
        assert code in (1, 2)
        error = capsys.readouterr().err
        assert (
            1
            <= len([each for each in error.splitlines() if not each.startswith(("usage: ", " "))])
            <= 3
        )
        assert "Traceback" not in error
        assert [path for path in tmp_path.rglob("*") if path.is_file()] == [file]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_stop_a_command_like_ctrl_c(
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


def test_robot_domain_and_map_are_those_of_a_running_nav2_unless_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parameters = {
        "/".join(filter(None, reversed(node))): values for node, values in PARAMETERS.items()
    }
    nav2_setup.write_files(
        nav2_setup.facts_of(parameters, nav2_setup.Given()), hall_map(), tmp_path, "map"
    )
    namespaces: list[str] = []

    def found(namespace: str) -> Path:
        namespaces.append(namespace)
        return tmp_path

    monkeypatch.setattr(nav2_setup, "set_up", found)
    parser = argparse.ArgumentParser(prog="tool")
    add_setting(parser)
    add_nav2(parser)
    read: list[tuple[Domain, str]] = []
    given = str(ROOT / "config" / "turtlebot4.yaml")
    for words in (["--nav2"], ["--nav2", "robot_1", "--robot", given], ["--domain", "drive"]):
        code = run_tool(
            parser, lambda options, domain, _: read.append((domain, options.robot)), words
        )
        assert code == 0
    assert [domain.name for domain, _ in read] == ["stations", "stations", "drive"]
    assert [domain.grid is not None for domain, _ in read] == [True, True, False]
    assert [robot for _, robot in read] == [str(tmp_path / "robot.yaml"), given, ""]
    assert namespaces == ["", "robot_1"]
