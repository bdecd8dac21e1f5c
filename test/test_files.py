"""Files of this package: valid ones are read, errors are reported in one line."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from ator_ros.files import FileError, load, portable_command, save
from ator_ros.schema import SchemaError, Within, structured, unstructured


@dataclass(frozen=True)
class Wheel:
    radius: Annotated[float, Within(0.0)]
    side: Literal["left", "right"] = "left"


@dataclass(frozen=True)
class Cart:
    name: str
    wheels: tuple[Wheel, ...]
    loads: dict[str, Annotated[float, Within(-1.0, 1.0)]]
    number: int | None = None

    def __post_init__(self) -> None:
        if len(self.wheels) > 2:
            raise ValueError("expected at most two wheels")


GOOD: dict[str, Any] = {
    "name": "a",
    "wheels": [{"radius": 1}, {"radius": 2.5, "side": "right"}],
    "loads": {"x": 1},
}


def test_valid_data_is_structured() -> None:
    assert structured(GOOD, Cart) == Cart("a", (Wheel(1.0), Wheel(2.5, "right")), {"x": 1.0})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": 3}, "name: expected a text; got 3"),
        (
            {"wheels": [{"radius": 1}, {"radius": -1}]},
            "wheels[1].radius: expected a finite number of at least 0; got -1",
        ),
        ({"wheels": [{"radius": True}]}, "wheels[0].radius: expected a finite number; got True"),
        (
            {"wheels": [{"side": "left"}]},
            "wheels[0]: expected the fields radius [side]; missing radius",
        ),
        (
            {"wheels": [{"radius": 1, "side": "top"}]},
            "wheels[0].side: expected one of left, right; got 'top'",
        ),
        ({"loads": {"x": 2}}, "loads.x: expected a number from -1 to 1; got 2"),
        ({"number": 1.0}, "number: expected a whole number; got 1.0"),
        ({"extra": 1}, "expected the fields loads, name, wheels [number]; unknown extra"),
    ],
)
def test_invalid_data_is_rejected_with_its_location(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SchemaError) as refused:
        structured(GOOD | change, Cart)
    assert str(refused.value) == message


def test_saved_data_is_loaded_unchanged(tmp_path: Path) -> None:
    file, cart = tmp_path / "cart.json", structured(GOOD, Cart)
    save(file, "cart", cart)
    assert json.loads(file.read_text()) == {
        "format": "ator_ros cart",
        "schema_version": 1,
    } | unstructured(cart)
    assert load(file, "cart", Cart) == cart


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"format": "ator_ros boat"}', "format: expected 'ator_ros cart', got 'ator_ros boat'"),
        ('{"format": "ator_ros cart", "schema_version": 2}', "schema_version: expected 1, got 2"),
        (
            '{"format": "ator_ros cart", "schema_version": 1}',
            "expected the fields loads, name, wheels",
        ),
        ("{", "expected a readable JSON file"),
        ("9" * 400, "format: expected 'ator_ros cart', got no table"),
    ],
)
def test_an_invalid_file_is_rejected_with_its_name(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "cart.json"
    file.write_text(text)
    with pytest.raises(FileError, match=rf"cart\.json: {message}"):
        load(file, "cart", Cart)
    with pytest.raises(FileError, match="there is none"):
        load(tmp_path / "none.json", "cart", Cart)


def test_a_recorded_command_has_full_topics_but_no_local_folders(tmp_path: Path) -> None:
    words = [
        str(tmp_path / "bag"),
        f"--models={tmp_path / 'm'}",
        "--odom=/robot1/odom",
        "--cmd-vel",
        "cmd_vel",
    ]
    assert (
        portable_command("train", words)
        == "train bag --models=m --odom=/robot1/odom --cmd-vel cmd_vel"
    )
