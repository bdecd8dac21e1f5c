"""The form of robots' files when soccer was all there was, with one ball and two goals; see `FormerForm`."""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Mapping
from dataclasses import make_dataclass
from typing import Any

from ator_ros.robot.former_form import FormerForm

_HOLDER = {"length": "fin_length", "gap": "fin_gap", "thickness": "fin_thickness", "limits": "dribble_limits"}
_AREA = ("length", "width", "margin")
_BAY = {"width": "goal_width", "depth": "goal_depth"}
_LIMITS = ("v", "w", "a", "brake", "aw")
_BALL = ("radius", "mass", "rolling_deceleration", "restitution")
_SIDES = ((-1.0, math.pi), (1.0, 0.0))

_SHOWN = {
    **{f"robot.holder.{new}": f"robot.{old}" for new, old in _HOLDER.items()},
    **{f"robot.holder.limits.{name}": f"robot.dribble_limits.{name}" for name in _LIMITS},
    "robot.holder.radius": "ball.radius",
    "scene.objects.ball": "ball",
    **{f"scene.objects.ball.{name}": f"ball.{name}" for name in _BALL},
    "scene.area": "field",
    **{f"scene.area.{name}": f"field.{name}" for name in _AREA},
    **{f"scene.bays[{i}].{new}": f"field.{old}" for i in range(2) for new, old in _BAY.items()},
}


@functools.cache
def _schema(robot: frozenset[str]) -> type[Any]:
    """Return the schema of the fields; their values are checked once they are renamed.

    In place of `holder` such a file has fields of its own.
    """
    section = _fields({*robot, *_HOLDER.values()} - {"holder"})
    field = _fields({*_AREA, *_BAY.values()})
    return make_dataclass("FormerFile", [("robot", section), ("ball", Any), ("field", field)])


def _fields(names: Collection[str]) -> type[Any]:
    return make_dataclass("FormerSection", [(name, Any) for name in sorted(names)])


def _renamed(data: Mapping[str, Any]) -> dict[str, Any]:
    robot, ball, field = dict(data["robot"]), data["ball"], data["field"]
    holder = {new: robot.pop(old) for new, old in _HOLDER.items()}
    robot["holder"] = holder | {"radius": ball.get("radius") if isinstance(ball, Mapping) else None}
    sizes = {new: field[old] for new, old in _BAY.items()}
    # A length that is no number is refused before the bays are looked at.
    half = field["length"] / 2 if isinstance(field["length"], int | float) else 0.0
    bays = [{"x": side * half, "y": 0.0, "yaw": yaw, **sizes} for side, yaw in _SIDES]
    area = {name: field[name] for name in _AREA}
    return {"robot": robot, "scene": {"area": area, "objects": {"ball": ball}, "bays": bays}}


def _written(content: Mapping[str, Any]) -> Mapping[str, Any] | None:
    holder, scene = content["holder"], content["scene"]
    if holder is None or set(scene["objects"]) != {"ball"} or len(scene["bays"]) != len(_SIDES):
        return None
    ball, area, bay = scene["objects"]["ball"], scene["area"], scene["bays"][0]
    field = {**area, **{old: bay[new] for new, old in _BAY.items()}}
    rest = {name: value for name, value in content.items() if name not in ("holder", "scene")}
    former = {**rest, **{old: holder[new] for new, old in _HOLDER.items()}, "ball": ball, "field": field}
    both = _renamed({"robot": {**former}, "ball": ball, "field": field})
    said = both["scene"]["bays"] == list(scene["bays"]) and holder["radius"] == ball["radius"]
    return former if said else None


FORM = FormerForm(
    sections=frozenset({"ball", "field"}), shown=_SHOWN, schema=_schema, renamed=_renamed, written=_written
)
