"""Files of ours: what fits is read, what does not is refused in one line with its place in the file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from ator_ros.files import FileError, load, save
from ator_ros.schema import OneOf, SchemaError, Within, structured, unstructured


@dataclass(frozen=True)
class Wheel:
    radius: Annotated[float, Within(0.0)]
    side: Annotated[str, OneOf(("left", "right"))] = "left"


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


def test_what_fits_is_structured() -> None:
    assert structured(GOOD, Cart) == Cart("a", (Wheel(1.0), Wheel(2.5, "right")), {"x": 1.0})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": 3}, "cart.name: expected a text; got 3"),
        ({"wheels": "ab"}, "cart.wheels: expected a list; got 'ab'"),
        (
            {"wheels": [{"radius": 1}, {"radius": -1}]},
            "cart.wheels[1].radius: expected a finite number of at least 0; got -1",
        ),
        ({"wheels": [{"radius": True}]}, "cart.wheels[0].radius: expected a finite number; got True"),
        ({"wheels": [{"radius": "1"}]}, "cart.wheels[0].radius: expected a finite number; got '1'"),
        ({"wheels": [{"radius": float("nan")}]}, "cart.wheels[0].radius: expected a finite number; got nan"),
        ({"wheels": [{"side": "left"}]}, "cart.wheels[0]: expected the fields radius [side]; missing radius"),
        (
            {"wheels": [{"radius": 1, "side": "top"}]},
            "cart.wheels[0].side: expected one of left, right; got 'top'",
        ),
        ({"wheels": [{"radius": 1}] * 3}, "cart: expected at most two wheels"),
        ({"loads": []}, "cart.loads: expected a table; got []"),
        ({"loads": {"x": 2}}, "cart.loads.x: expected a number from -1 to 1; got 2"),
        ({"number": 1.0}, "cart.number: expected a whole number; got 1.0"),
        ({"number": True}, "cart.number: expected a whole number; got True"),
        ({"extra": 1}, "cart: expected the fields loads, name, wheels [number]; unknown extra"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SchemaError) as refused:
        structured(GOOD | change, Cart, "cart", closed=True)
    assert str(refused.value) == message


def test_messages_are_short_whatever_came() -> None:
    with pytest.raises(SchemaError) as refused:
        structured(GOOD | {"wheels": "x" * 1_000_000}, Cart, "cart." + "y" * 1_000_000)
    assert len(str(refused.value)) < 600


def test_what_is_saved_is_loaded_again(tmp_path: Path) -> None:
    file, cart = tmp_path / "cart.json", structured(GOOD, Cart)
    save(file, "cart", cart)
    assert json.loads(file.read_text()) == {"format": "ator_ros cart", "schema_version": 1} | unstructured(
        cart
    )
    assert load(file, "cart", Cart) == cart


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"format": "ator_ros boat"}', "format: expected 'ator_ros cart', got 'ator_ros boat'"),
        ("[]", "format: expected 'ator_ros cart', got no table"),
        ('{"format": "ator_ros cart", "schema_version": 2}', "schema_version: expected 1, got 2"),
        ('{"format": "ator_ros cart", "schema_version": 1}', "expected the fields loads, name, wheels"),
        ("{", "expected a readable JSON file"),
        ("9" * 400, "expected a readable JSON file: expected numbers below 1e300"),
    ],
)
def test_another_file_is_refused_by_its_name(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "cart.json"
    file.write_text(text)
    with pytest.raises(FileError, match=rf"cart\.json: {message}"):
        load(file, "cart", Cart)
    with pytest.raises(FileError, match="there is none"):
        load(tmp_path / "none.json", "cart", Cart)


@dataclass(frozen=True, kw_only=True)
class Journey:
    by: tuple[Near, ...]
    note: str | None = None
    took: float | None
    carts: Mapping[str, Cart] = field(default_factory=dict)


def test_a_dataclass_is_written_as_it_is_read_without_what_it_leaves_open() -> None:
    bare = Journey(by=(Near("a", 1.0),), took=None)
    plain = unstructured(bare)
    assert json.loads(json.dumps(plain)) == {"by": [{"place": "a", "within": 1.0}], "took": None, "carts": {}}
    noted = Journey(by=(), note="slow", took=2.0, carts={"a": structured(GOOD, Cart)})
    assert list(unstructured(noted)) == ["by", "note", "took", "carts"]
    for journey in (bare, noted):
        assert structured(json.loads(json.dumps(unstructured(journey))), Journey, closed=True) == journey


CHECKOUT = Path(__file__).resolve().parents[1]
SHIPPED = [file for folder in ("docs", "models") for file in sorted((CHECKOUT / folder).rglob("*.json"))]


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: str(file.relative_to(CHECKOUT)))
def test_files_that_ship_say_their_format_and_version(file: Path) -> None:
    data = json.loads(file.read_text(encoding="utf-8"))
    assert data["format"].startswith("ator_ros ")
    assert data["schema_version"] >= 1


@dataclass(frozen=True)
class Near:
    place: str
    within: float


@dataclass(frozen=True)
class Between:
    place: str
    low: float = 0.0


@dataclass(frozen=True)
class Choices:
    kind: Literal["near", "far"]
    value: bool | int | str | None
    where: tuple[Near | Between, ...] = ()


def test_a_union_is_the_first_of_its_types_that_fits() -> None:
    for value in (True, 1, "1", None):
        made = structured({"kind": "near", "value": value}, Choices)
        assert made.value is value
    where = [{"place": "a", "within": 1.0}, {"place": "b", "low": 2.0}, {"place": "c"}]
    made = structured({"kind": "far", "value": 0, "where": where[:2]}, Choices, closed=True)
    assert made.where == (Near("a", 1.0), Between("b", 2.0))


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ({"kind": "on", "value": 1}, "kind: expected one of near, far; got 'on'"),
        ({"kind": 1, "value": 1}, "kind: expected one of near, far; got 1"),
        ({"kind": "far", "value": 0.5}, "value: expected true or false or a whole number or a text; got 0.5"),
        (
            {"kind": "far", "value": 1, "where": [3]},
            "where[0]: expected a table with place, within or a table with place [low]; got 3",
        ),
    ],
)
def test_what_fits_no_type_of_a_union_is_told(data: object, expected: str) -> None:
    with pytest.raises(SchemaError) as caught:
        structured(data, Choices, closed=True)
    assert str(caught.value) == expected
