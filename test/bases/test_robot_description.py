"""Descriptions of robots and scenes: file content, digests, robots without a holder."""

import dataclasses
from pathlib import Path

import pytest
import yaml
from robots import loaded

from ator_ros.actions.base import Goal
from ator_ros.bases.description import ConfigError, Robot, load_robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.resources import resource_path
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

ROBOT = load_robot()
# The digest of the shipped models and gates; a change requires new ones.
DIGEST = "2e92e5309bc515f2"


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return the shipped robot without its holder, read from a file."""
    data = yaml.safe_load(resource_path("config", "pioneer.yaml").read_text(encoding="utf-8"))
    del data["robot"]["holder"]
    data["robot"]["name"] = "plain"
    file = tmp_path_factory.mktemp("plain") / "plain.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return SOCCER.robot(file)


def test_the_digest_of_the_shipped_robot_is_unchanged() -> None:
    assert ROBOT.digest() == SOCCER.robot().digest() == DIGEST


def test_a_written_file_describes_the_same_robot(plain: Robot, tmp_path: Path) -> None:
    for robot in (ROBOT, plain):
        assert loaded(robot.sections(), tmp_path) == robot


def test_base_and_holder_identify_a_robot(plain: Robot) -> None:
    holder = ROBOT.holder
    others = [
        dataclasses.replace(ROBOT, mass=12.0),
        dataclasses.replace(ROBOT, holder=dataclasses.replace(holder, gap=0.26)),
        dataclasses.replace(ROBOT, holder=dataclasses.replace(holder, radius=0.12)),
        plain,
    ]
    assert len({robot.digest() for robot in (ROBOT, *others)}) == 1 + len(others)


def test_a_described_build_is_simulated(tmp_path: Path) -> None:
    data = ROBOT.sections()
    numbers = {"mass_behind": 0.05, "mass_height": 0.11, "caster_behind": 0.19}
    data["robot"]["build"] = {**numbers, "wheel_mass": 0.5, "wheel_inertia": 0.007}
    urdf = robot_urdf(loaded(data, tmp_path))
    assert 'xyz="-0.05 0 0.11"' in urdf
    assert 'xyz="-0.19 0 0.0375"' in urdf
    assert '<mass value="0.5"/><inertia ixx="0.007"' in urdf
    assert '<mass value="8"/>' in urdf


def test_a_robot_that_only_servers_drive_needs_no_wheels(tmp_path: Path) -> None:
    data = load_robot(resource_path("config", "turtlebot4.yaml")).sections()
    body = {
        name: data["robot"].pop(name)
        for name in ("wheel_radius", "track", "mass", "wheel_torque", "motor_time_constant")
    }
    robot = loaded(data, tmp_path)
    domain = find_domain(str(resource_path("config", "nav2", "stations.yaml")))
    assert [top.name for top in domain.library(robot).usable()] == ["visit"]
    assert loaded(robot.sections(), tmp_path) == robot
    missing = "expected the fields mass, motor_time_constant, track, wheel_radius, wheel_torque"
    drives = find_domain("drive").library(robot)
    for needs in (robot_urdf, Simulation, lambda _: drives.action(drives["goToPose"])):
        with pytest.raises(ConfigError, match=missing):
            needs(robot)

    for name, value in body.items():
        data["robot"][name] = value
        if name != "motor_time_constant":  # the last
            with pytest.raises(ConfigError, match="missing"):
                loaded(data, tmp_path)
    assert robot_urdf(loaded(data, tmp_path))


def test_soccer_needs_a_ball_in_the_scene(tmp_path: Path) -> None:
    data = ROBOT.sections()
    del data["scene"]["objects"]["ball"]
    file = tmp_path / "no_ball.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    message = r"no_ball\.yaml: domain soccer: scene\.objects: expected 'ball' among them, got \[\]$"
    with pytest.raises(ConfigError, match=message):
        SOCCER.robot(file)


def test_missing_holder_is_reported(plain: Robot) -> None:
    says = "^dribbleBall needs a holder; robot plain has none$"
    for action_set in SOCCER.action_sets:
        library = SOCCER.library(plain, action_set)
        assert [top.name for top in library.usable()] == ["goToPose"]
        with pytest.raises(ConfigError, match=says):
            library.action(library["dribbleBall"])
    calls = [
        TopCall(library[name], Goal(Pose(1.0, 1.0, 0.0))) for name in ("goToPose", "dribbleBall")
    ]
    (reason,) = TopChain(tuple(calls)).violations(
        World(0.0, RobotState(Pose(0.0, 0.0, 0.0))), plain
    )
    assert reason == "dribbleBall needs a holder; robot plain has none"


@pytest.mark.parametrize(
    ("part", "name", "value", "message"),
    [
        (
            "robot",
            "track",
            0.4,
            r"own\.yaml: robot\.track: expected at most 0\.38, the width .* got 0\.4$",
        ),
        (
            "holder",
            "gap",
            0.2,
            r"robot\.holder\.gap: expected at least 0\.22, the width .* got 0\.2$",
        ),
        (
            "holder",
            "radius",
            0.123,
            r"robot\.holder\.radius: expected .* \(ball 0\.11\), got 0\.123$",
        ),
        (
            "robot",
            "wheel_torque",
            0.3,
            r"robot\.wheel_torque: expected at least 0\.351.*9 kg .* got 0\.3$",
        ),
        (
            "build",
            "wheel_mass",
            4.5,
            r"robot\.build\.wheel_mass: expected at most 4\.41, .* got 4\.5$",
        ),
        (
            "build",
            "mass_behind",
            0.3,
            r"robot\.build\.mass_behind: expected at most 0\.24, .* got 0\.3$",
        ),
        (
            "build",
            "caster_behind",
            0.25,
            r"robot\.build\.caster_behind: expected at most 0\.24, .* got",
        ),
    ],
)
def test_inconsistent_sizes_are_rejected(
    part: str, name: str, value: float, message: str, tmp_path: Path
) -> None:
    data = ROBOT.sections()
    (data["robot"] if part == "robot" else data["robot"].setdefault(part, {}))[name] = value
    with pytest.raises(ConfigError, match=message):
        loaded(data, tmp_path)


def test_name_and_scene_do_not_identify_a_robot() -> None:
    scene = ROBOT.scene
    others = [
        dataclasses.replace(ROBOT, name="mine"),
        *(
            dataclasses.replace(ROBOT, scene=dataclasses.replace(scene, **changed))
            for changed in (
                {"objects": {}},
                {"bays": ()},
                {"area": dataclasses.replace(scene.area, length=30.0)},
                {"area": dataclasses.replace(scene.area, x=5e5, y=5e6)},
            )
        ),
    ]
    assert {robot.digest() for robot in others} == {DIGEST}
    assert len({robot.description_digest() for robot in (ROBOT, *others)}) == 1 + len(others)
