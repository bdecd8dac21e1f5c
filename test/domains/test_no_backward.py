"""Bases that never drive backward (`limits.v_back: 0`): planned, driven and predicted without."""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from action_runs import KINDS, Task, execute

from ator_ros.actions.base import Action, ActionError, Goal, Point, Status, Step
from ator_ros.bases.description import ConfigError, Robot, load_robot, robot_of
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.go_to_ball import GoToPoseOrBall as GoToPose
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.performance.derived import Geometry
from ator_ros.resources import resource_path
from ator_ros.schema import SchemaError
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.state import Command, ObjectState, RobotState, World


def forward_only(robot: Robot) -> Robot:
    limits = dataclasses.replace(robot.limits, v_back=0.0)
    return dataclasses.replace(robot, name=f"{robot.name}_forward", limits=limits)


PIONEER = load_robot()
FORWARD = forward_only(PIONEER)
TURTLEBOT = forward_only(load_robot(resource_path("config", "turtlebot4.yaml")))


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the file that describes the robot."""
    file = tmp_path_factory.mktemp("robot") / "forward.yaml"
    file.write_text(yaml.safe_dump(FORWARD.sections()), encoding="utf-8")
    assert load_robot(file) == FORWARD
    return str(file)


def test_the_setting_belongs_to_the_robot() -> None:
    assert FORWARD.digest() != PIONEER.digest()
    assert "v_back" not in PIONEER.sections()["robot"]["limits"]
    assert FORWARD.limits.scaled(0.5).backward == 0.0
    assert FORWARD.limits.within(PIONEER.limits).backward == 0.0


def described_with(limits: dict[str, float], holder_limits: dict[str, float]) -> Robot:
    content = yaml.safe_load(yaml.safe_dump(PIONEER.sections()))
    content["robot"]["limits"] |= limits
    content["robot"]["holder"]["limits"] |= holder_limits
    return robot_of(content)


def test_greatest_speed_backward_is_0_or_that_forward() -> None:
    assert described_with({"v_back": PIONEER.limits.v}, {}).digest() == PIONEER.digest()
    for v_back in (0.3, 15.0):
        with pytest.raises(SchemaError, match=rf"limits: v_back: expected 0, .* got {v_back:g}$"):
            described_with({"v_back": v_back}, {})
    with pytest.raises(SchemaError, match=r"v_back: expected 0, .* got 0\.1$"):
        described_with({}, {"v_back": 0.1})
    with pytest.raises(
        ConfigError, match=r"robot\.holder\.limits\.v_back: expected none, .* got 0$"
    ):
        described_with({}, {"v_back": 0.0})


@pytest.mark.parametrize(("action_set", "seed"), [("default", 78), ("bezier", 11)])
@pytest.mark.parametrize("kind", KINDS)
def test_no_action_drives_backward(kind: str, action_set: str, seed: int, described: str) -> None:
    outcomes = [execute(Task(kind, action_set, seed, index, described)) for index in range(6)]
    failures = [outcome.reason for outcome in outcomes if not outcome.success]
    # Some situations begin with the ball at the front, which only a drive backward leaves.
    assert len([reason for reason in failures if "(limits.v_back: 0)" not in reason]) <= 1
    assert len(failures) <= 2
    assert max(outcome.backward for outcome in outcomes) <= 0.0


@pytest.mark.parametrize("robot", [FORWARD, TURTLEBOT], ids=lambda robot: robot.name)
@pytest.mark.parametrize("v", [0.0, 0.4, -0.3, -0.001])
@pytest.mark.parametrize("speed", [0.0, 0.2])
def test_goals_behind_are_reached_in_the_predicted_time(
    robot: Robot, v: float, speed: float
) -> None:
    """Shares of the limit at the start, and m/s at the goal."""
    start, goal = RobotState(Pose(0.0, 0.0, 0.3), v * robot.limits.v), Pose(-1.5, -0.3, 0.5)
    least = [0.0]

    def watched(action: Action, world: World) -> Step:
        step = action.step(world)
        least.append((step.command or Command()).vx)
        return step

    with Simulation(robot) as simulation:
        place(simulation, World(0.0, start, {}))
        done = run_action(simulation, GoToPose(robot), Goal(goal, speed), step=watched)
        assert done.status is Status.SUCCEEDED, done.message
        assert min(least) == 0.0
        duration = simulation.time
    direct = {
        "x": 0.0, "y": 0.0, "yaw": 0.3, "v": start.vx, "w": 0.0, "hold": 0.0,
        "xg": goal.x, "yg": goal.y, "yawg": goal.yaw, "speedg": speed,
    }  # fmt: skip
    geometry = Geometry({name: np.array([value]) for name, value in direct.items()}, robot)
    assert geometry.path[0][0] == pytest.approx(duration, abs=0.5)


def test_a_robot_too_near_the_ball_names_the_setting() -> None:
    start = RobotState(Pose(0.0, 0.0, 0.0))
    ball = {BALL: ObjectState(FORWARD.hold, 0.0)}
    goal = Goal(Pose(-2.0, 0.0, math.pi), 0.0, Point.AXLE)
    GoToPose(PIONEER).start(World(0.0, start, ball), goal)
    with pytest.raises(ActionError, match=r"never drives backward \(limits\.v_back: 0\)"):
        GoToPose(FORWARD).start(World(0.0, start, ball), goal)


def test_situations_do_not_begin_backward() -> None:
    rng = np.random.default_rng(3)
    sample = SOCCER.actions("default")["goToPose"].sample
    assert min(sample(FORWARD, rng).robot.vx for _ in range(200)) >= 0.0
