"""Domains as YAML files: what they declare is used, and what is wrong is told in one sentence."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from documentation import ROOT

from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.domains.domain import Domain, DomainError, find_domain
from ator_ros.domains.programs import Program
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.tour.stand_in import DriveToStandIn
from ator_ros.geometry import Pose
from ator_ros.refinement.free_variables import analyse
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.conditions import Condition, Region, Term
from ator_ros.tops.ranges import USUAL_RANGES
from ator_ros.tops.top import Top
from ator_ros.world.sources import ObjectSource
from ator_ros.world.state import RobotState, World

ROBOT = load_robot()
TOUR: dict[str, Any] = {
    "name": "errands",
    "objects": [{"name": "cart", "topic": "/cart/pose", "type": "PoseStamped", "optional": True}],
    "tops": [
        {
            "name": "visit",
            "action": "navigate",
            "pre": [
                {"variable": "cart.x", "target": 3, "tolerance": 2},
                {"variable": "robot.x", "target": 0.0, "low": 0.5},
            ],
            "post": [
                {"variable": "robot.x", "target": "goal.x", "tolerance": 0.25},
                {"variable": "robot.y", "target": "goal.y", "tolerance": 0.25},
            ],
        },
        {
            "name": "fetch",
            "action": "goToPose",
            "point": "hold",
            "post": [{"variable": "hold.x", "target": "cart.x", "tolerance": 0.1}],
        },
    ],
    "actions": [
        {
            "name": "navigate",
            "remote": {
                "server": "navigate_to_pose",
                "type": "nav2_msgs/action/NavigateToPose",
                "goal": [{"field": "pose", "source": "goal", "frame": "map"}],
                "success": {"fields": [{"field": "error_code", "equals": 0}]},
            },
        },
        {"name": "goToPose", "local": {"domain": "soccer"}},
    ],
    "variables": [{"name": "yaw"}, {"name": "speed", "low": 0.1, "high": 0.4}],
}


PLACE = {"x": [-1, 1], "y": [0.5]}
CHAIN: dict[str, Any] = {"name": "walk", "start": [PLACE], "steps": [{"top": "visit", "goal": [PLACE]}]}


class _Plain(yaml.SafeDumper):
    """Writes no aliases, which are refused."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def file_of(folder: Path, data: object) -> Path:
    file = folder / "tour.yaml"
    file.write_text(data if isinstance(data, str) else yaml.dump(data, Dumper=_Plain), encoding="utf-8")
    return file


@pytest.fixture
def tour(tmp_path: Path) -> Domain:
    return find_domain(str(file_of(tmp_path, TOUR)))


def test_a_file_declares_objects_tops_actions_and_variables(tour: Domain) -> None:
    assert tour.name == "errands"
    assert tour.source("cart") == ObjectSource("cart", "/cart/pose", "PoseStamped", optional=True)
    near = tuple(Term(f"robot.{axis}", f"goal.{axis}", 0.25) for axis in "xy")
    visit, fetch = tour.tops
    assert visit == Top(
        "visit",
        "navigate",
        Condition((Term("cart.x", 3.0, 2.0), Region("robot.x", 0.0, 0.5))),
        Condition(near),
    )
    assert fetch.point is Point.HOLD
    assert tour.actions()["goToPose"] is SOCCER.actions()["goToPose"]
    assert tour.actions()["navigate"].remote is not None


def test_a_variable_has_its_declared_range(tour: Domain) -> None:
    goal = Goal(Pose(0.0, 0.0, 0.0))
    assert set(tour.variables) == {"yaw", "speed"}
    assert tour.variables["yaw"](ROBOT, goal) == USUAL_RANGES["yaw"](ROBOT, goal)
    speed = tour.variables["speed"](ROBOT, goal)
    assert (speed.low, speed.high, speed.rest) == (0.1, 0.4, 0.1)


def test_a_variable_that_is_not_declared_is_not_free(tour: Domain) -> None:
    visit = tour.library(ROBOT)["visit"]
    call = TopCall(visit, Goal(Pose(1.0, 1.0, 0.0)), frozenset({"x"}))
    analysis = analyse(TopChain((call,)), {}, ROBOT, tour.variables)
    assert [item.reason for item in analysis.not_free] == ["without a range"]


def test_a_heading_within_bounds_is_no_longer_periodic(tmp_path: Path) -> None:
    data = TOUR | {"variables": [{"name": "yaw", "low": -0.5, "high": 0.5}]}
    yaw = find_domain(str(file_of(tmp_path, data))).variables["yaw"](ROBOT, Goal(Pose(0.0, 0.0, 0.0)))
    assert (yaw.low, yaw.high, yaw.periodic) == (-0.5, 0.5, False)


def test_without_the_section_every_variable_may_be_opened(tmp_path: Path) -> None:
    data = {key: value for key, value in TOUR.items() if key != "variables"}
    assert find_domain(str(file_of(tmp_path, data))).variables is USUAL_RANGES


def test_a_remote_action_cannot_start_without_ros(tour: Domain) -> None:
    library = tour.library(ROBOT)
    action = library.action(library["visit"])
    with pytest.raises(ActionError, match="over ROS only"):
        action.start(World(0.0, RobotState(Pose(0.0, 0.0, 0.0))), Goal(Pose(1.0, 0.0, 0.0)))


def test_a_file_may_name_a_robot_its_bays_chains_drives_a_stand_in_and_servers(tmp_path: Path) -> None:
    data = copy.deepcopy(TOUR) | {
        "robot": "small.yaml",
        "bays": True,
        "chains": [CHAIN],
        "servers": [{"package": "fleet", "executable": "driver"}],
        "time_limit": 90,
    }
    data["actions"][0] |= {"drives": {"start": [PLACE], "goal": [PLACE]}, "stand_in": "drive_to"}
    sections = yaml.safe_load((ROOT / "config" / "pioneer.yaml").read_text(encoding="utf-8"))
    sections["robot"]["name"] = "small"
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(sections), encoding="utf-8")
    domain = find_domain(str(file_of(tmp_path, data)))
    robot = domain.robot()
    assert robot.name == "small"
    assert len(robot.scene.bays) == 2
    assert domain.robot(ROOT / "config" / "pioneer.yaml").name == "pioneer_3dx"
    assert domain.programs == (Program("fleet", "driver"),)
    assert domain.time_limit == 90.0
    assert domain.remote_servers() == ("navigate_to_pose",)
    _, chain = domain.chains["walk"](robot, domain.library(robot), np.random.default_rng(0))
    assert [(call.top.name, call.goal.pose.y) for call in chain.calls] == [("visit", 0.5)]
    navigate = domain.actions()["navigate"]
    assert navigate.factory is DriveToStandIn
    assert navigate.sample(robot, np.random.default_rng(0)).goal.pose.y == 0.5


def test_what_is_not_declared_cannot_be_driven(tour: Domain) -> None:
    with pytest.raises(DomainError, match="expected `drives` in the domain's file to collect it, got none"):
        tour.actions()["navigate"].sample(ROBOT, np.random.default_rng(0))


def changed(path: str, value: object) -> dict[str, Any]:
    """Return the domain with the value at a path replaced, or a field added."""
    data = copy.deepcopy(TOUR)
    *way, last = (int(key) if key.isdigit() else key for key in path.split("."))
    inner: Any = data
    for key in way:
        inner = inner[key]
    inner[last] = value
    return data


def test_an_action_on_a_server_declares_goal_variables(tmp_path: Path) -> None:
    data = copy.deepcopy(TOUR)
    action, top = data["actions"][0], data["tops"][0]
    action["goal_variables"] = [{"name": "height", "unit": "m", "low": 0.0, "high": 1.5, "rest": 0.2}]
    action["remote"]["goal"].append({"field": "lift", "source": "goal.height"})
    top["pre"].append({"variable": "robot.v", "target": "goal.height", "high": 0.0})
    domain = find_domain(str(file_of(tmp_path, data)))
    library = domain.library(load_robot())
    (height,) = library.goal_variables(library["visit"])
    assert height == GoalVariable("height", "m", 0.0, 1.5, rest=0.2)
    assert library.goal(library["visit"], Pose(0.0, 0.0, 0.0)).values == {"height": 0.2}
    assert "height" in library.ranges
    assert not library.goal_variables(library["fetch"])


@pytest.mark.parametrize(
    ("action", "variable", "expected"),
    [
        (0, {"name": "yaw"}, r"actions\[0\].goal_variables\[0\]: name: expected none of x, y, yaw, speed"),
        (0, {"high": -1.0}, r"goal_variables\[0\]: height: low, high: expected finite numbers"),
        (1, {}, r"actions\[1\]: goal_variables: expected none without `remote`"),
    ],
)
def test_goal_variables_that_cannot_be_are_refused(
    tmp_path: Path, action: int, variable: dict[str, Any], expected: str
) -> None:
    data = copy.deepcopy(TOUR)
    usual = {"name": "height", "unit": "m", "low": 0.0, "high": 1.5}
    data["actions"][action]["goal_variables"] = [usual | variable]
    with pytest.raises(DomainError, match=expected):
        find_domain(str(file_of(tmp_path, data)))


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("name", "my tour", "name: expected a name of letters, digits and _; got 'my tour'"),
        ("name", "soccer", "name: expected none of the installed domains, .*'soccer'"),
        ("colour", 1, "expected the fields actions, .*variables; unknown colour"),
        ("objects.0.type", "Pose", r"objects\[0\].type: expected one of Odometry, PoseStamped.*got 'Pose'"),
        ("objects.0.name", "robot", r"objects\[0\]: name: expected a name .*none of robot.*got 'robot'"),
        ("objects.0.topic", "a b", r"objects\[0\]: topic: expected the name of a topic; got 'a b'"),
        ("tops.0.action", "fly", r"tops\[0\].action: expected one of navigate, goToPose; got 'fly'"),
        ("tops.1.name", "visit", "tops: expected each name once; got 'visit'"),
        ("tops", [], r"tops: expected at least one; got \[\]"),
        ("tops.0.post", [], r"tops\[0\]: post: expected at least one term"),
        (
            "tops.0.post.1.variable",
            "dog.x",
            r"tops\[0\].post\[1\].variable: expected one of robot.x, .*dog.x",
        ),
        ("tops.0.post.1.target", "goal.z", r"tops\[0\].post\[1\].target: expected one of .*got 'goal.z'"),
        ("tops.0.post.1.tolerance", -1, r"tops\[0\].post\[1\].tolerance: expected a number that is not neg"),
        ("tops.0.post.1.tolerance", math.nan, r"post\[1\].tolerance: expected a finite number; got nan"),
        ("tops.0.post.1.tolerance", True, r"post\[1\].tolerance: expected a finite number; got True"),
        ("tops.0.pre.1.high", 0.1, r"tops\[0\].pre\[1\]: range of robot.x: expected low <= high"),
        ("tops.0.pre.1.tolerance", 1, r"tops\[0\].pre\[1\]: expected the fields .*; unknown low"),
        ("tops.0.settles", -1, r"tops\[0\]: settles: expected a time in s from 0 to 60; got -1"),
        ("tops.0.post.1", 5, r"tops\[0\].post\[1\]: expected a table with .*; got 5"),
        ("tops.0.point", "tail", r"tops\[0\].point: expected one of axle, hold; got 'tail'"),
        ("actions.1.local.domain", "chess", r"actions\[1\].local: domain: expected an entry point .*'chess'"),
        ("actions.1.local.action_set", "fast", r"actions\[1\].local: action set of soccer: expected one of"),
        ("actions.0.local", {"domain": "soccer"}, r"actions\[0\]: local, remote: expected one of the two"),
        (
            "actions.0.remote.server",
            "",
            r"actions\[0\].remote: server: expected the name of an action server",
        ),
        ("actions.0.remote.type", "Pose", r"actions\[0\].remote: type: expected a type as in .*; got 'Pose'"),
        ("actions.0.remote.goal", [], r"actions\[0\].remote: goal: expected at least one field"),
        (
            "actions.0.remote.goal.0.source",
            "ball",
            r"goal\[0\]: source: expected one of goal, goal.x, .*'ball'",
        ),
        ("actions.0.remote.goal.0.constant", 0, r"goal\[0\]: source, constant: expected one of the two"),
        ("actions.0.remote.goal.0.field", "a..b", r"goal\[0\]: field: expected names joined by dots"),
        ("actions.0.remote.timeouts", {"result": 0}, r"timeouts: result: expected a time in s above 0"),
        ("actions.0.remote.success.status", [], r"success: status: expected at least one state"),
        (
            "actions.0.stand_in",
            "walk",
            r"actions\[0\].stand_in: expected an entry point of ator_ros.stand_ins, one of .*'walk'",
        ),
        ("actions.1.stand_in", "drive_to", r"actions\[1\]: stand_in: expected none without `remote`"),
        ("actions.0.drives", {"start": [], "goal": []}, r"actions\[0\].drives: start: expected at least one"),
        ("actions.0.drives", {"start": [{"x": [0]}]}, r"drives.start\[0\]: expected the fields .*missing y"),
        ("chains", [{"name": "a"}], r"chains\[0\]: expected the fields .*; missing start, steps"),
        ("chains", [CHAIN | {"name": "a b"}], r"chains\[0\]: name: expected a name"),
        ("chains", [CHAIN, CHAIN], "chains: expected each name once; got 'walk'"),
        (
            "chains",
            [CHAIN | {"steps": [{"top": "fly", "goal": [PLACE]}]}],
            r"chains\[0\].steps\[0\].top: expected one of visit, fetch; got 'fly'",
        ),
        ("servers", [{"package": "a b", "executable": "c"}], r"servers\[0\]: package: expected a name"),
        ("time_limit", 0, "time_limit: expected a time in s from 0 to 3600"),
        ("variables.0.name", "z", r"variables\[0\].name: expected one of x, y, yaw, speed; got 'z'"),
        ("variables.1.high", 0.1, r"variables\[1\]: high: expected a number above low, 0.1; got 0.1"),
        ("variables.1.low", None, r"variables\[1\]: low, high: expected both or neither"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(
    tmp_path: Path, path: str, value: object, expected: str
) -> None:
    file = file_of(tmp_path, changed(path, value))
    with pytest.raises(DomainError, match=f"^{file}: .*{expected}"):
        find_domain(str(file))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1, 2]", "expected a table with actions"),
        ("name: errands", "; missing actions, tops"),
        ("a: &a [1]\nb: *a\n", "expected no alias, got *a"),
        ("name: [", "expected a readable YAML file"),
        ("#" * 200_001, "expected at most 0.2 MB, got more"),
        ("name: !!python/object:os.system x", "expected a readable YAML file"),
    ],
)
def test_what_is_no_domain_at_all_is_told_too(tmp_path: Path, text: str, expected: str) -> None:
    file = file_of(tmp_path, text)
    with pytest.raises(DomainError) as caught:
        find_domain(str(file))
    assert expected in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match=r"none.yaml: expected a readable YAML file: .*No such file"):
        find_domain(str(tmp_path / "none.yaml"))
