"""Names from outside are cut and escaped in logs, answers and terminals."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import PoseStamped, TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid, Odometry
from nodes.test_readme import LIBRARY, ROBOT, answered

from ator_interfaces import msg
from ator_interfaces.srv import RefineSubgoal
from ator_ros.bases.description import load_robot
from ator_ros.domains.domain import domain_for
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.nodes import messages
from ator_ros.nodes.subscriptions import TfListener
from ator_ros.printable import ReadableError, listed, one_line
from ator_ros.resources import resource_path
from ator_ros.tools import train
from ator_ros.world.grid_map import load_map
from ator_ros.world.readers import (
    FrameError,
    MessageError,
    OdometryReader,
    transform_from,
    world_from,
)

HOSTILE = [
    "base\nlink",
    "\x1b[2J\x1b]0;title\x07",
    "a\u202egnp.exe",
    "\u2066hidden\u2069\u200b",
    "tab\tand\rreturn",
    "x" * 10_000,
    "\x00\x7f\x9b31m",
    "; " * 5_000,
]
FRAME = "odom"


def call_with(**fields: object) -> msg.TopChain:
    top = fields.pop("top", "goToPose")
    return msg.TopChain(calls=[msg.TopCall(top=top, **fields)])


def in_frame(frame: str) -> PoseStamped:
    stamped = PoseStamped()
    stamped.header.frame_id = frame
    return stamped


def odometry(frame: str) -> Odometry:
    message = Odometry(child_frame_id=frame)
    message.header.frame_id = frame
    return message


def transform(name: str) -> TransformStamped:
    message = TransformStamped(child_frame_id=name)
    message.header.frame_id = name
    message.transform.rotation.w = 0.0
    return message


def grid(frame: str) -> OccupancyGrid:
    message = OccupancyGrid()
    message.header.frame_id = frame
    return message


def situation(name: str, frame: str = FRAME) -> msg.Situation:
    message = msg.Situation(objects=[msg.ObjectState(name=name), msg.ObjectState(name=name)])
    message.header.frame_id = frame
    return message


def chain(read: msg.TopChain) -> object:
    messages.action_set_from(read, allowed=("default",))
    return messages.chain_from(read, LIBRARY, frame=FRAME)


FROM_MESSAGES: dict[str, Callable[[str], object]] = {
    "TOP": lambda name: chain(call_with(top=name)),
    "TOP of the library": lambda name: LIBRARY[name],
    "action set": lambda name: chain(msg.TopChain(action_set=name)),
    "open variable": lambda name: chain(call_with(open=[name])),
    "many open variables": lambda name: chain(call_with(open=[name] * 500)),
    "declared value": lambda name: chain(call_with(values=[msg.GoalValue(name=name)])),
    "frame of a goal": lambda name: chain(call_with(goal=in_frame(name))),
    "object": lambda name: world_from(situation(name), frame=FRAME),
    "frame of a situation": lambda name: world_from(situation("ball", name), frame=FRAME),
    "frame of odometry": lambda name: OdometryReader(FRAME).read(odometry(name)),
    "frame in tf": lambda name: transform_from(transform(name)),
    "frame of a map": lambda name: messages.grid_from(grid(name), "map", frame=FRAME),
    "goal of a plan": lambda name: messages.statements_from(
        msg.PlanGoal(name=name), SOCCER.goals(ROBOT), ()
    ),
    "variable of a goal": lambda name: messages.statements_from(
        msg.PlanGoal(terms=[msg.GoalTerm(variable=name)]), SOCCER.goals(ROBOT), ("robot.x",)
    ),
}


def is_readable(text: str) -> bool:
    return text.isprintable() and len(text) <= 300


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
@pytest.mark.parametrize("place", FROM_MESSAGES)
def test_a_name_in_a_message_is_cut_and_escaped(place: str, name: str) -> None:
    with pytest.raises((ReadableError, KeyError)) as caught:
        FROM_MESSAGES[place](name)
    assert is_readable(str(caught.value)), str(caught.value)[:400]


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_frames_of_tf_are_named_cut_and_escaped(name: str) -> None:
    listener = TfListener(None)  # type: ignore[arg-type]
    message = transform(name)
    message.transform.rotation.w = 1.0
    for number in range(12):
        message.child_frame_id = f"{number} {name}"
        listener.transforms.add(*transform_from(message), fixed=True)
    problem = listener.problem(name, "base")
    assert is_readable(problem), problem
    assert "got the frames: " in problem


FILES: dict[str, Callable[[Path], object]] = {
    "robot": load_robot,
    "map": load_map,
    "domain": lambda file: domain_for(str(file), None),
}


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
@pytest.mark.parametrize("kind", FILES)
def test_keys_values_and_names_of_files_are_cut_and_escaped(
    tmp_path: Path, kind: str, name: str
) -> None:
    file = tmp_path / "file.yaml"
    names = {name: name, "image": name, "robot": {name: name}, "name": name}
    for content in (yaml.safe_dump(names), json.dumps([name]), name, f"{name}: 1\n{name}: 1"):
        file.write_text(content, encoding="utf-8", errors="replace")
        with pytest.raises(ReadableError) as caught:
            FILES[kind](file)
        assert is_readable(str(caught.value)), str(caught.value)[:400]
    with pytest.raises(ReadableError) as caught:
        FILES[kind](tmp_path / f"{name[:100]}.yaml".replace("\x00", ""))
    assert is_readable(str(caught.value)), str(caught.value)[:400]


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_the_name_of_a_robot_must_be_printable(tmp_path: Path, name: str) -> None:
    file = tmp_path / "robot.yaml"
    content = yaml.safe_load(resource_path("config", "turtlebot4.yaml").read_text(encoding="utf-8"))
    content["robot"]["name"] = name
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(ReadableError, match=r"robot\.name: expected a printable name") as caught:
        load_robot(file)
    assert is_readable(str(caught.value))


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_a_tool_names_a_file_in_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"{name[:100]}.parquet".replace("\x00", "")
    file.write_bytes(b"no table")
    assert train.main([str(file), "--models", str(tmp_path / "models")]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert all(line.isprintable() for line in lines), lines
    assert len(lines[-1]) <= 620


def test_a_chain_in_which_nothing_is_free_has_a_short_reason() -> None:
    calls = [msg.TopCall(top="goToBall", open=["x", "y"], goal=in_frame(FRAME)) for _ in range(30)]
    start = msg.Situation(objects=[msg.ObjectState(name="ball")])
    start.robot.position.x = -2.0
    answer = answered(RefineSubgoal.Request(situation=start, chain=msg.TopChain(calls=calls)))
    assert answer.reason.startswith("nothing is free: x of step 1 (goToBall) is ")
    assert len(answer.not_free) == 60
    texts = [answer.reason, *(each.reason for each in answer.not_free)]
    assert all(map(is_readable, texts)), max(texts, key=len)


@given(st.text(alphabet=st.characters(exclude_categories=()), max_size=2000))
def test_any_message_becomes_one_line(text: str) -> None:
    shown = one_line(text)
    assert is_readable(shown)
    assert one_line(shown) == shown
    shown.encode()


def test_a_long_message_keeps_its_first_parts_or_both_ends() -> None:
    many = "; ".join(f"reason {number:03d}" for number in range(200))
    assert one_line(many).startswith("reason 000; reason 001; ")
    assert one_line(many).endswith("; and 176 more")
    assert one_line(f"{many}; and 54 more").endswith("; and 230 more")
    shown = one_line(f"file: {'x' * 1000}: expected a map")
    assert shown.startswith("file: xxx")
    assert shown.endswith("xxx: expected a map")
    error = FrameError("a\n" * 500, got="map")
    assert isinstance(error, MessageError)
    assert is_readable(str(error))


def test_lists_are_bounded() -> None:
    assert listed(["a", "b\n"]) == "a, b\\n"
    assert listed(map(str, range(17))) == "0, 1, 2, 3, 4, … and 12 more"
