"""Command lines with numbers that make no sense end with one line that says what was expected."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from ator_ros.tools import collect, evaluate, view
from ator_ros.tools.command_line import whole

NUMBERS = {
    "collect": ["--episodes", "--seed"],
    "evaluate": ["--situations", "--seed", "--oracle"],
    "gate": ["--situations", "--seed"],
    "demo": ["--situations", "--seed"],
}


@pytest.mark.parametrize("text", ["-1", "nan", "1.5", "", "1e3", "many"])
@pytest.mark.parametrize(
    ("command", "option"), [(c, option) for c, names in NUMBERS.items() for option in names]
)
def test_numbers_that_are_none_are_refused(
    command: str, option: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit) as ended:
        tool.main([f"{option}={text}"])
    assert ended.value.code == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith(f"{command}: error: argument {option}: expected a whole number from ")
    assert repr(text) in told


@pytest.mark.parametrize("text", ["0", "-2", "1.5", "", "-", "many"])
@pytest.mark.parametrize("command", ["collect", "evaluate", "gate"])
def test_no_jobs_are_refused(command: str, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit):
        tool.main([f"--jobs={text}"])
    told = capsys.readouterr().err.splitlines()[-1]
    expected = f"expected a whole number from 1, got {text!r}; or -1, one per core"
    assert told == f"{command}: error: argument --jobs: {expected}"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        *(
            (["--robots", name], "expected a namespace of at most 100 letters")
            for name in (
                "a b",
                "../x",
                "//ann",
                "/",
                "",
                "ann/",
                "ann//x",
                "1abc",
                "é",
                "a" * 101,
                "__ns",
                "a\nb",
            )
        ),
        (["--robots", "ann", "/ann"], "--robots: expected different names, got ann ann"),
        *((["--frame", name], "expected the name of a frame") for name in ("a b", "//odom", "é", "x" * 101)),
    ],
)
def test_a_view_of_names_that_are_none_is_refused(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        view.main(["--attach", *words])
    assert ended.value.code == 2
    assert told in capsys.readouterr().err.splitlines()[-1]


DESTINATIONS = {
    "calibrate_predictions": ["--report"],
    "collect": ["--out"],
    "demo": ["--out"],
    "train": ["--ablation", "--report"],
}


@pytest.mark.parametrize(
    ("command", "option"), [(c, option) for c, names in DESTINATIONS.items() for option in names]
)
def test_a_result_that_cannot_be_written_is_refused_before_the_work(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    for place in (tmp_path, tmp_path / "file" / "result", tmp_path / "file" / "folder" / "result"):
        with pytest.raises(SystemExit) as ended:
            tool.main([f"{option}={place}"])
        assert ended.value.code == 2
        told = capsys.readouterr().err.splitlines()[-1]
        assert f"argument {option}: expected a file that can be written, got {str(place)!r}" in told


def test_a_table_that_train_would_not_know_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        collect.main([f"--out={tmp_path / 'table.txt'}"])
    assert "argument --out: expected a file named .parquet" in capsys.readouterr().err


def test_whole_numbers_within_bounds_are_read() -> None:
    assert whole(1, 3)("3") == 3
    assert whole()("0") == 0


@pytest.mark.parametrize("command", ["collect", "evaluate", "gate", "train"])
def test_a_domain_that_is_not_installed_is_told_in_one_line(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit) as ended:
        tool.main(["--domain=chess"])
    assert ended.value.code == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith(f"{command}: error: domain: expected an entry point of ator_ros.domains, one of [")
    assert told.endswith("got 'chess'")


TOOLS = ("collect", "train", "gate", "evaluate", "calibrate_predictions", "study", "plan")


@pytest.mark.parametrize("command", TOOLS)
def test_a_robot_and_a_domain_can_be_named(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit):
        tool.main(["--help"])
    told = capsys.readouterr().out
    assert "--robot FILE" in told
    assert "--domain NAME" in told


BARE = """
name: bare
tops:
  - name: visit
    action: fly_to
    post: [{variable: robot.x, target: goal.x, tolerance: 0.25}]
actions: []
"""
LACKING = {
    "actions": ["collect"],
    "chains": ["demo", "evaluate", "gate"],
}


@pytest.mark.parametrize(("kind", "command"), [(kind, c) for kind, names in LACKING.items() for c in names])
def test_a_domain_that_lacks_what_a_command_works_on_is_told_in_one_line(
    kind: str, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bare.yaml").write_text(BARE)
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit) as ended:
        tool.main([f"--domain={tmp_path / 'bare.yaml'}"])
    assert ended.value.code == 2
    told = capsys.readouterr().err.splitlines()[-1]
    expected = f"argument --domain: expected one with {kind}, got bare, which has none"
    assert told == f"{command}: error: {expected}"


def test_a_view_of_a_domain_without_chains_starts_no_nodes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bare.yaml").write_text(BARE)
    assert view.main([f"--domain={tmp_path / 'bare.yaml'}"]) == 1
    told = capsys.readouterr()
    assert told.err == "view: domain: expected one with chains, got bare, which has none\n"
    assert "nodes start" not in told.out


NAMES = [
    ("collect", "--action-set", "default, bezier"),
    ("collect", "--actions", "goToPose, dribbleBall, shoot"),
    ("gate", "--action-set", "default, bezier"),
    ("evaluate", "--chain", "dribble, drive, rolling, shoot"),
    ("evaluate", "--policies", "naive, face_goal"),
]


@pytest.mark.parametrize(("command", "option", "known"), NAMES)
def test_names_that_the_domain_lacks_are_told_in_one_line(
    command: str, option: str, known: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit) as ended:
        tool.main([option, "chess"])
    assert ended.value.code == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith(f"{command}: error: argument {option}: expected one of {known}")
    assert told.endswith("got 'chess'")


NODES = ("simulation", "executor", "refinement", "learning", "goal_pose")
HELP = """
import importlib, sys
for module in sys.argv[1:]:
    try:
        importlib.import_module(module).main([module, "--help"])
    except SystemExit as ended:
        assert ended.code == 0
assert not [name for name in ("sklearn", "pandas", "pybullet") if name in sys.modules], "imported"
"""


def test_help_of_nodes_is_printed_without_what_only_their_work_needs() -> None:
    pytest.importorskip("rclpy")
    modules = [*(f"ator_ros.nodes.{name}" for name in NODES), "ator_ros.examples.drive_to_server"]
    command = [sys.executable, "-c", HELP, *modules]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.stderr, done.returncode) == ("", 0)
    assert done.stdout.count("usage: ") == len(modules)
    assert "rotate_above" in done.stdout  # a parameter of drive_to_server


def test_no_banner_of_a_library_is_at_the_head_of_the_output() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from ator_ros.simulation.physics import connect"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout + done.stderr == ""


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--oracle-speeds", "0.2"], "--oracle-speeds: expected --oracle, too"),
        (["--oracle-margin", "1"], "--oracle-margin: expected --oracle, too"),
        (
            ["--oracle", "4", "--oracle-jointly", "--oracle-speeds", "0.2"],
            "--oracle-speeds: expected none beside --oracle-jointly",
        ),
    ],
)
def test_options_that_would_do_nothing_are_refused(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        evaluate.main(words)
    assert ended.value.code == 2
    assert told in capsys.readouterr().err
