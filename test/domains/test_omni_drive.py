"""The domain `drive` with omnidirectional robots."""

import dataclasses
import math

import pytest
from omni_robots import ALIKE, ROBOTS

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step
from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.bases.omni.planar_motion import planar_plan
from ator_ros.domains.drive import DRIVE, tops_for
from ator_ros.domains.planned.planar_go_to_pose import PlanarGoToPose
from ator_ros.experience.simulated import episode_generator, run_episode
from ator_ros.geometry import Pose
from ator_ros.simulation.run import run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.library import top_of
from ator_ros.world.state import Command, RobotState, World

each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
SPEC = DRIVE.actions()["goToPose"]
EPISODES = 12
SEED = 65


@each_robot
def test_drives_succeed_about_as_fast_as_planned(robot: OmniRobot) -> None:
    for number in range(EPISODES):
        situation = SPEC.situation(robot, episode_generator("goToPose", SEED, number))
        with Simulation(robot) as simulation:
            top = top_of(situation, tops_for(robot), robot)
            episode = run_episode(simulation, SPEC.factory(robot), situation, top=top)
        assert episode.success, episode.reason
        goal = situation.goal
        plan = planar_plan(situation.robot, goal.pose, goal.speed, robot.limits)
        assert episode.duration < 1.1 * plan.duration + 0.4


@each_robot
def test_it_drives_straight_to_the_side_while_it_turns(robot: OmniRobot) -> None:
    with Simulation(robot) as simulation:
        simulation.place_robot(Pose(-1.0, -2.0, 0.0))
        worlds: list[World] = []

        def watched(action: Action, world: World) -> Step:
            worlds.append(world)
            return action.step(world)

        goal = Goal(Pose(-1.0, 2.0, math.pi / 2.0))
        done = run_action(simulation, PlanarGoToPose(robot), goal, step=watched)
    assert done.status is Status.SUCCEEDED
    assert max(abs(world.robot.pose.x + 1.0) for world in worlds) < 0.05


@each_robot
def test_a_push_aside_is_corrected(robot: OmniRobot) -> None:
    goal = Goal(Pose(2.0, 0.0, 1.0))
    with Simulation(robot) as simulation:
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))

        def pushed(action: Action, world: World) -> Step:
            if world.time == pytest.approx(1.0):
                x, y, yaw = world.robot.pose
                simulation.place_robot(Pose(x, y + 0.3, yaw + 0.5), world.robot.velocity)
            return action.step(simulation.world())

        done = run_action(simulation, PlanarGoToPose(robot), goal, step=pushed)
        assert done.status is Status.SUCCEEDED
        assert simulation.world().robot.pose.distance(goal.pose) < 0.06


def test_a_base_weaker_than_described_arrives_late() -> None:
    goal = Goal(Pose(4.0, 0.0, 1.0))
    weak = dataclasses.replace(
        ALIKE, limits=dataclasses.replace(ALIKE.limits, a=1.2, brake=1.2, v=1.5)
    )
    with Simulation(weak) as simulation:
        simulation.place_robot(Pose(-4.0, 0.0, 0.0))
        done = run_action(simulation, PlanarGoToPose(ALIKE), goal)
        assert done.status is Status.SUCCEEDED, done.message
        assert simulation.world().robot.pose.distance(goal.pose) < 0.06


def test_a_robot_at_its_goal_has_nothing_to_do() -> None:
    action = PlanarGoToPose(ALIKE)
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
    action.start(world, Goal(Pose(0.01, 0.0, 0.02)))
    step = action.step(world)
    assert step.status is Status.SUCCEEDED
    assert step.command == Command()


def test_an_arrival_speed_above_the_limit_is_refused() -> None:
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
    with pytest.raises(ActionError, match="expected an arrival speed from 0 to 3 m/s, got 4"):
        PlanarGoToPose(ALIKE).start(world, Goal(Pose(2.0, 0.0, 0.0), 4.0))


def test_a_robot_that_misses_a_goal_which_it_should_pass_comes_back() -> None:
    goal = Goal(Pose(1.0, 0.0, 0.0), 1.0)
    with Simulation(ALIKE) as simulation:
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))

        def pushed(action: Action, world: World) -> Step:
            if world.robot.pose.x > 0.9 and world.time < 3.0:
                turned = world.robot.pose._replace(yaw=1.5)
                simulation.place_robot(turned, world.robot.velocity)
            return action.step(simulation.world())

        done = run_action(simulation, PlanarGoToPose(ALIKE), goal, step=pushed, time_limit=20.0)
        assert done.status is Status.SUCCEEDED, done.message
        assert simulation.world().robot.pose.distance(goal.pose) < 0.06
