"""Command lines that make no sense end with one line that says what was expected."""

from __future__ import annotations

import copy
import importlib
import io
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from domain_files import CHAIN, PLACE, TOUR, file_of

from ator_ros.tools import collect, evaluate, gate, study, train, view

NUMBERS = {
    "collect": ["--episodes", "--seed"],
    "evaluate": ["--oracle"],
    "demo": ["--situations"],
}


@pytest.mark.parametrize("text", ["-1", "1.5"])
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
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.startswith(f"{command}: error: argument {option}: expected a whole number from ")
    assert repr(text) in message


@pytest.mark.parametrize(
    ("words", "message"),
    [
        *(
            (["--robots", name], "expected a namespace of at most 100 letters")
            for name in (
                "a b",
                "../x",
                "a" * 101,
            )
        ),
        (["--robots", "ann", "/ann"], "--robots: expected different names, got ann ann"),
        *((["--frame", name], "expected the name of a frame") for name in ("//odom",)),
    ],
)
def test_a_view_of_names_that_are_none_is_refused(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        view.main(["--attach", *words])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


DESTINATIONS = {
    "calibrate_predictions": ["--report"],
    "collect": ["--out"],
    "demo": ["--out"],
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
        message = capsys.readouterr().err.splitlines()[-1]
        assert f"argument {option}: expected a file that can be written, got {str(place)!r}" in message


@pytest.mark.parametrize("command", ["collect", "evaluate", "gate", "train"])
def test_a_domain_that_is_not_installed_is_told_in_one_line(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit) as ended:
        tool.main(["--domain=chess"])
    assert ended.value.code == 2
    (message,) = capsys.readouterr().err.splitlines()  # without the usage
    assert message.startswith(
        f"{command}: error: domain: expected an entry point of ator_ros.domains, one of ["
    )
    assert message.endswith("got 'chess'")


TOOLS = ("collect", "train", "gate", "evaluate", "calibrate_predictions", "study", "plan")


@pytest.mark.parametrize("command", TOOLS)
def test_a_robot_and_a_domain_can_be_named(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit):
        tool.main(["--help"])
    message = capsys.readouterr().out
    assert "--robot FILE" in message
    assert "--domain NAME" in message


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
    message = capsys.readouterr().err.splitlines()[-1]
    expected = f"argument --domain: expected one with {kind}, got bare, which has none"
    assert message == f"{command}: error: {expected}"


NAMES = [
    ("collect", "--action-set", "default, bezier"),
    ("evaluate", "--chain", "dribble, drive, rolling, shoot"),
]


@pytest.mark.parametrize(("command", "option", "known"), NAMES)
def test_names_that_the_domain_lacks_are_told_in_one_line(
    command: str, option: str, known: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    with pytest.raises(SystemExit) as ended:
        tool.main([option, "chess"])
    assert ended.value.code == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.startswith(f"{command}: error: argument {option}: expected one of {known}")
    assert message.endswith("got 'chess'")


NODES = ("simulation", "executor", "refinement", "learning", "goal_pose")
HELP = """
import importlib, sys
for module in sys.argv[1:]:
    try:
        importlib.import_module(module).main([module, "--help"])
    except SystemExit as ended:
        assert ended.code == 0
assert not [name for name in ("sklearn", "pybullet") if name in sys.modules], "imported"
"""


def test_help_of_nodes_is_printed_without_what_only_their_work_needs() -> None:
    pytest.importorskip("rclpy")
    modules = [*(f"ator_ros.nodes.{name}" for name in NODES), "ator_ros.examples.drive_to_server"]
    command = [sys.executable, "-c", HELP, *modules]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.stderr, done.returncode) == ("", 0)
    assert done.stdout.count("usage: ") == len(modules)
    assert "rotate_above" in done.stdout  # a parameter of drive_to_server


def shown(monkeypatch: pytest.MonkeyPatch, name: str, words: list[str]) -> tuple[int, str]:
    """Run `train` on a terminal with PYTHONIOENCODING=ascii; return exit code and text of a stream."""
    raw = io.BytesIO()
    monkeypatch.setattr(sys, name, io.TextIOWrapper(raw, "ascii", write_through=True))
    code = train.main(words)
    return code, raw.getvalue().decode("ascii")


def test_an_error_that_names_a_file_in_another_script_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text = shown(monkeypatch, "stderr", ["böse.parquet"])
    assert code == 1
    assert text.startswith("train: b\\xf6se.parquet: expected a Parquet file")
    assert text.count("\n") == 1


Tool = Callable[[Sequence[str]], int]


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        (collect.main, ["--episodes", "2", "--seed", "1", "--out", "table.parquet"]),
        (evaluate.main, ["--situations", "1", "--policies", "naive", "--out", "out"]),
        (gate.main, ["--situations", "10", "--models", "models"]),
    ],
)
def test_it_is_refused_with_the_reason(
    tool: Tool,
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    data = copy.deepcopy(TOUR) | {"chains": [CHAIN]}
    data["actions"][0] |= {"drives": {"start": [PLACE], "goal": [PLACE]}}
    file = file_of(tmp_path, data)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").mkdir()
    assert tool([*words, "--domain", str(file)]) == 1
    assert "has no `stand_in`, so only `collect --over-ros`" in capsys.readouterr().err
    assert not (tmp_path / "table.parquet").exists()
    assert not list((tmp_path / "models").rglob("*.json"))


def test_a_study_of_such_actions_alone_leaves_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    action = TOUR["actions"][0] | {"drives": {"start": [PLACE], "goal": [PLACE]}}
    data = {**TOUR, "tops": TOUR["tops"][:1], "actions": [action], "chains": [CHAIN]}
    assert study.main(["--domain", str(file_of(tmp_path, data)), "--out", str(tmp_path / "study")]) == 1
    assert "has no `stand_in`, so only `collect --over-ros`" in capsys.readouterr().err
    assert not (tmp_path / "study").exists()
