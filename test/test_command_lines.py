"""Command lines with numbers that make no sense end with one line that says what was expected."""

from __future__ import annotations

import importlib

import pytest

from ator_ros.tools.command_line import whole

NUMBERS = {
    "collect": ["--episodes", "--seed"],
    "evaluate": ["--situations", "--seed", "--oracle"],
    "gate": ["--situations", "--seed"],
    "qualify": ["--situations", "--turned", "--pairs", "--seed"],
    "noise": ["--situations", "--seed"],
    "soak": ["--seed"],
    "demo": ["--situations", "--seed"],
    "compare": ["--situations", "--seed"],
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


def test_whole_numbers_within_bounds_are_read() -> None:
    assert whole(1, 3)("3") == 3
    assert whole()("0") == 0
