"""Domains as YAML files: declarations are used, errors are reported with their location."""

import copy
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from documentation import ROOT
from domain_files import CHAIN, PLACE, TOUR, changed, file_of

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.remote import Timeouts
from ator_ros.bases.description import load_robot
from ator_ros.domains.declared import DeclaredServer, DeclaredVariable
from ator_ros.domains.domain import Domain, DomainError, find_domain
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Region, Term
from ator_ros.tops.ranges import USUAL_RANGES
from ator_ros.world.readers import ObjectSource
from ator_ros_examples.stand_ins import DriveToStandIn

ROBOT = load_robot()


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
    remote = tour.actions()["navigate"].remote
    assert remote.timeouts == Timeouts(
        server=2.0, acceptance=2.0, silence=3.0, result=120.0, cancel=1.0
    )


def test_a_variable_has_its_declared_range(tour: Domain) -> None:
    goal = Goal(Pose(0.0, 0.0, 0.0))
    assert set(tour.variables) == {"yaw", "speed"}
    assert tour.variables["yaw"](ROBOT, goal) == USUAL_RANGES["yaw"](ROBOT, goal)
    speed = tour.variables["speed"](ROBOT, goal)
    assert (speed.low, speed.high, speed.rest) == (0.1, 0.4, 0.1)


def test_a_declared_range_of_headings_is_a_part_of_the_circle() -> None:
    declared = DeclaredVariable("yaw", -1.0, 1.0).range(ROBOT, Goal(Pose(0.0, 0.0, 0.0)))
    assert declared.periodic
    assert declared.contains(2.0 * math.pi + 0.5)
    assert not declared.contains(math.pi)
    part = declared.within([(0.5, 2.0)])
    assert part is not None
    assert part.span == pytest.approx((0.5, 1.0))


def test_a_file_may_declare_robot_bays_chains_drives_stand_in_and_servers(tmp_path: Path) -> None:
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
    assert domain.servers == (DeclaredServer("fleet", "driver"),)
    assert domain.time_limit == 90.0
    assert domain.remote_servers() == ("navigate_to_pose",)
    _, chain = domain.chains["walk"](robot, domain.library(robot), np.random.default_rng(0))
    assert [(call.top.name, call.goal.pose.y) for call in chain.calls] == [("visit", 0.5)]
    navigate = domain.actions()["navigate"]
    assert navigate.factory is DriveToStandIn
    assert navigate.sample(robot, np.random.default_rng(0)).goal.pose.y == 0.5


def test_a_server_may_be_a_command_beside_the_file(tmp_path: Path) -> None:
    command = ["python3", "my_server.py", "--speed", "0.5 m/s"]
    data = copy.deepcopy(TOUR) | {
        "servers": [{"command": command}, {"command": command, "folder": "ws"}]
    }
    beside, below = find_domain(str(file_of(tmp_path, data))).servers
    assert beside.command == tuple(command)
    assert beside.name == "python3 my_server.py --speed '0.5 m/s'"
    assert (beside.folder, below.folder) == (str(tmp_path), str(tmp_path / "ws"))


def test_an_action_on_a_server_declares_goal_variables(tmp_path: Path) -> None:
    data = copy.deepcopy(TOUR)
    action, top = data["actions"][0], data["tops"][0]
    action["drives"] = {"start": [PLACE], "goal": [PLACE]}
    data["chains"] = [CHAIN]
    action["goal_variables"] = [
        {"name": "height", "unit": "m", "low": 0.0, "high": 1.5, "rest": 0.2}
    ]
    action["remote"]["goal"].append({"field": "lift", "source": "goal.height"})
    top["pre"].append({"variable": "robot.vx", "target": "goal.height", "high": 0.0})
    domain = find_domain(str(file_of(tmp_path, data)))
    library = domain.library(load_robot())
    (height,) = library.goal_variables(library["visit"])
    assert height == GoalVariable("height", "m", 0.0, 1.5, rest=0.2)
    assert library.goal(library["visit"], Pose(0.0, 0.0, 0.0)).values == {"height": 0.2}
    assert "height" in library.ranges
    robot, rng = load_robot(), np.random.default_rng(0)
    assert 0.0 < domain.actions()["navigate"].sample(robot, rng).goal.values["height"] < 1.5
    _, chain = domain.chains["walk"](robot, library, rng)
    assert chain.calls[0].goal.values == {"height": 0.2}
    assert not library.goal_variables(library["fetch"])


def test_a_top_without_a_declared_action_is_omitted(tmp_path: Path) -> None:
    data = copy.deepcopy(TOUR)
    data["tops"][0]["action"] = "fly"
    data["tops"][0]["post"].append(
        {"variable": "robot.x", "target": "goal.height", "tolerance": 1.0}
    )
    library = find_domain(str(file_of(tmp_path, data))).library(load_robot())
    assert list(library) == ["fetch"]
    assert library.left_out == {
        "visit": "visit needs the action fly; action set default has none of that name"
    }


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("name", "my tour", "name: expected a name of letters, digits and _; got 'my tour'"),
        ("name", "soccer", "name: expected none of the installed domains, .*'soccer'"),
        ("color", 1, r"expected the fields actions, .*variables\]; unknown color"),
        (
            "objects.0.type",
            "Pose",
            r"objects\[0\].type: expected one of Odometry, PoseStamped.*got 'Pose'",
        ),
        (
            "tops.0.post.1.target",
            "goal.z",
            r"tops.visit.post\[1\].target: expected one of .*got 'goal.z'",
        ),
        (
            "tops.0.post.1.tolerance",
            math.nan,
            r"post\[1\].tolerance: expected a finite number; got nan",
        ),
        ("tops.0.pre.1.high", 0.1, r"tops\[0\].pre\[1\]: range of robot.x: expected low <= high"),
        (
            "actions.0.remote.cancel_too",
            ["follow_path", "follow_path"],
            r"actions\[0\].remote: cancel_too: expected each name once, without .*'follow_path'",
        ),
        (
            "actions.1.local.domain",
            "chess",
            r"actions\[1\].local: domain: expected an entry point .*'chess'",
        ),
        (
            "actions.1.local.domain",
            "./errands.yaml",
            r"actions\[1\].local: domain: expected an entry point .*'./errands.yaml'",
        ),
        (
            "actions.0.local",
            {"domain": "soccer"},
            r"actions\[0\]: local, remote: expected one of the two",
        ),
        (
            "actions.0.remote.goal.0.source",
            "ball",
            r"goal\[0\]: source: expected one of goal, goal.x, .*'ball'",
        ),
        (
            "actions.0.drives",
            {"start": [], "goal": []},
            r"actions\[0\].drives.start: expected at least one",
        ),
        ("chains", [CHAIN | {"start": [{"x": [1, 0], "y": [0]}]}], "x: expected .*least, greatest"),
        ("chains", [CHAIN | {"steps": []}], "steps: expected 1 to 100"),
        ("chains", [CHAIN | {"apart": -1.0}], "apart: expected a number"),
        ("chains", [CHAIN, CHAIN], "chains: expected each name once; got 'walk'"),
        (
            "chains",
            [CHAIN | {"steps": [{"top": "fly", "goal": [PLACE]}]}],
            r"chains\[0\].steps\[0\].top: expected one of visit, fetch; got 'fly'",
        ),
        (
            "servers",
            [{"package": "p", "executable": "e", "folder": "f"}],
            "folder: expected none without",
        ),
        ("variables.1.low", None, r"variables\[1\]: low, high: expected both or neither"),
    ],
)
def test_errors_are_reported_with_their_location(
    tmp_path: Path, path: str, value: object, expected: str
) -> None:
    file = file_of(tmp_path, changed(path, value))
    with pytest.raises(DomainError, match=f"^{file}: .*{expected}"):
        find_domain(str(file))
