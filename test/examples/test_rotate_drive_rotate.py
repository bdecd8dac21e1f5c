"""The control law of the example server, and the action that simulates the server."""

import math
import re

import pytest

from ator_ros.actions.base import Goal, Status
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tools import train
from ator_ros.world.state import Command, RobotState, World
from ator_ros_examples.rotate_drive_rotate import ENDED, Phase, RotateDriveRotate, State
from ator_ros_examples.stand_ins import DriveToStandIn

ROBOT = find_domain("tour").robot()


def phases(start: Pose, goal: Pose) -> tuple[list[Phase], list[Command], Pose]:
    """Drive in the simulation; return the phases in order, the commands, and the final pose."""
    law, phase, commands = RotateDriveRotate(tuple(goal)), [], []
    with Simulation(ROBOT) as simulation:
        place(simulation, World(0.0, RobotState(start)))
        while law.phase not in ENDED:
            state = simulation.world()
            robot = state.robot
            commands.append(Command(*law.step(State(state.time, *robot.pose, robot.vx, robot.w))))
            if not phase or phase[-1] is not law.phase:
                phase.append(law.phase)
            simulation.command(commands[-1])
            simulation.tick()
        return phase, commands, simulation.world().robot.pose


@pytest.mark.parametrize(
    ("start", "first", "backward"),
    [
        (Pose(-2.0, 0.0, 0.5), Phase.FOLLOWING, False),
        (Pose(-2.0, 0.0, 1.2), Phase.ROTATING_TO_PATH, False),
        (Pose(-2.0, 0.0, 3.0), Phase.FOLLOWING, True),
    ],
)
def test_phases_are_turn_follow_turn(start: Pose, first: Phase, backward: bool) -> None:
    goal = Pose(1.0, 0.3, 1.0)
    phase, commands, end = phases(start, goal)
    assert phase[0] is first
    assert phase[-4:] == [Phase.FOLLOWING, Phase.ROTATING_TO_GOAL, Phase.SETTLING, Phase.ARRIVED]
    assert (min(c.vx for c in commands) < -0.1) is backward
    assert (max(c.vx for c in commands) > 0.1) is not backward
    assert end.distance(goal) < 0.1
    assert abs(end.yaw - goal.yaw) < 0.16
    assert commands[-1] == Command()
    if first is Phase.ROTATING_TO_PATH:
        assert phase[1] is Phase.PAUSING
        turns, half = [abs(command.w) for command in commands], len(commands) // 2
        assert max(turns[:half]) > 1.3 * max(turns[half:])


def test_the_learned_rules_show_where_the_behavior_changes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert train.main(["--domain", "tour", "--rules", "drive_to"]) == 0
    backward, shared, *_ = capsys.readouterr().out.splitlines()
    (above,) = re.findall(r"straights are backward if angle_to_dest > ([\d.]+)", backward)
    assert float(above) == pytest.approx(120.0, abs=2.0)
    assert "*max(0, angle_to_straight - 40°)" in shared


def test_the_simulated_action_waits_for_the_robot_to_stop_and_succeeds() -> None:
    with Simulation(ROBOT) as simulation:
        place(simulation, World(0.0, RobotState(Pose(-1.0, 0.0, 0.0), 0.4)))
        goal = Goal(Pose(1.0, 0.5, math.pi / 2))
        steps = []

        def watched(action: object, world: World) -> object:
            steps.append(action.step(world))  # type: ignore[attr-defined]
            return steps[-1]

        done = run_action(simulation, DriveToStandIn(ROBOT), goal, time_limit=60.0, step=watched)
        assert done.status is Status.SUCCEEDED
        stopping = [step for step in steps if "stopping" in step.message]
        assert len(stopping) > 3
        assert all(step.command == Command() for step in stopping)
        assert simulation.world().robot.pose.distance(goal.pose) < 0.1
