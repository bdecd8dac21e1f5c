"""The node `plan_team` with two robots in one simulation."""

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from chain_client import call
from documentation import ROOT, commands
from process import PATIENCE, Processes, run
from rclpy.action import ActionClient
from ros_client import Client, SentGoal
from std_srvs.srv import Trigger

from ator_interfaces.action import PlanTeam
from ator_interfaces.msg import Outcome, Situation, TeamChain, TeamMember, TopCall
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of

STARTS = {"ann": Pose(-1.0, 0.0, 3.1), "bob": Pose(0.5, 0.0, 0.0)}
LEFT = [Pose(-2.5, 1.5, 0.0), Pose(-2.5, -1.5, 0.0)]
RIGHT = [Pose(2.5, 1.5, 0.0), Pose(2.5, -1.5, 0.0)]


@dataclass
class Planner:
    """A client of the action plan_team."""

    client: Client
    server: ActionClient

    def send(self, wanted: PlanTeam.Goal) -> SentGoal:
        return SentGoal(self.client, self.server, wanted)

    @property
    def domain(self) -> int:
        return self.client.domain

    def reset(self) -> None:
        """Place both robots where they start."""
        assert self.client.call(Trigger, "ann/reset", Trigger.Request()).success

    def result(self, wanted: PlanTeam.Goal) -> PlanTeam.Result:
        return self.send(wanted).response(2 * PATIENCE).result


@pytest.fixture(scope="module")
def planner(shared: tuple[Processes, Client]) -> Planner:
    """Return a client of plan_team beside the nodes of two robots."""
    processes, client = shared
    placed = [value for pose in STARTS.values() for value in pose]
    processes.start(
        "simulation", domain="drive", robots=list(STARTS), robot_start=placed,
        real_time_factor=5.0, command_wait=0.5,
    )  # fmt: skip
    for name in STARTS:
        frames = {"frame": f"{name}/odom", "domain": "drive"}
        processes.start("refinement", namespace=name, **frames)
        processes.start(
            "executor", namespace=name, robot_frame=f"{name}/base_link", odom_timeout=5.0, **frames
        )
    processes.start("plan_team")
    server = client.within(lambda: ActionClient(client.node, PlanTeam, "plan_team"))
    client.eventually(server.server_is_ready, "the action plan_team")
    wanted = {
        f"/{name}/{service}"
        for name in STARTS
        for service in ("refine_subgoal", "execute_chain/_action/send_goal")
    }
    found = client.node.get_service_names_and_types
    client.eventually(lambda: wanted <= {name for name, _ in found()}, "the robots' nodes")
    return Planner(client, server)


def station(pose: Pose) -> TopCall:
    found = call("goToPose", pose, opened=("yaw", "order"))
    found.goal.header.frame_id = "world"
    return found


def goal(calls: list[TopCall], **fields: object) -> PlanTeam.Goal:
    """Return a goal for both robots, which start at rest where the simulation places them."""
    wanted = PlanTeam.Goal(**fields)
    wanted.round.calls = calls
    for name, pose in STARTS.items():
        situation = Situation(robot=pose_of(pose))
        situation.header.frame_id = "world"
        wanted.robots.append(TeamMember(name=name, situation=situation))
    return wanted


def orders(result: PlanTeam.Result) -> dict[str, set[int]]:
    return {each.robot: set(each.order) for each in result.chains}


def test_each_robot_gets_the_stations_that_are_nearest(planner: Planner) -> None:
    result = planner.result(goal([*map(station, [LEFT[0], RIGHT[0], RIGHT[1], LEFT[1]])]))
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert orders(result) == {"ann": {0, 3}, "bob": {1, 2}}
    for part in result.chains:
        assert part.predicted.duration > 0.0
        assert part.chain.calls[0].goal.header.frame_id == f"{part.robot}/odom"


def test_what_belongs_together_goes_to_one_robot(planner: Planner) -> None:
    calls = [*map(station, [LEFT[0], RIGHT[0]])]
    calls[1].after = [0]
    (part,) = planner.result(goal(calls)).chains
    assert list(part.order) == [0, 1]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda wanted: wanted.robots.clear(), "robots: expected 1 to 16 items, got 0"),
        (
            lambda wanted: setattr(wanted.robots[1], "name", "ann"),
            "robots[1].name: expected another name than before, got 'ann'",
        ),
        (
            lambda wanted: setattr(wanted.robots[0], "name", "a b"),
            "robots[0].name: expected a namespace, such as robot_1, got 'a b'",
        ),
        (
            lambda wanted: setattr(wanted.round.calls[0], "top", "fly"),
            "step 1: expected a robot that can execute it, got none; ann: ",
        ),
        (
            lambda wanted: setattr(wanted.round.calls[0], "after", [99]),
            "step 1 (goToPose): after: expected indices of other calls",
        ),
        (
            lambda wanted: setattr(wanted.round.calls[0], "passing", True),
            "round.calls[0].passing: expected false, got true; open stop",
        ),
        (
            lambda wanted: setattr(wanted.robots[0], "name", "eve"),
            "expected eve/predict_durations",
        ),
    ],
)
def test_what_cannot_be_planned_is_refused_with_the_reason(
    planner: Planner, change: Callable[[PlanTeam.Goal], object], reason: str
) -> None:
    wanted = goal([station(LEFT[0])])
    change(wanted)
    outcome = planner.result(wanted).outcome
    assert outcome.code in (Outcome.REFUSED, Outcome.INPUT_LOST)
    assert reason in outcome.reason


def test_both_robots_drive_at_the_same_time(planner: Planner) -> None:
    planner.reset()
    result = planner.result(goal([*map(station, [*LEFT, *RIGHT])], execute=True))
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert orders(result) == {"ann": {0, 1}, "bob": {2, 3}}
    for part in result.chains:
        assert part.outcome.code == Outcome.SUCCEEDED
        assert part.actual.duration == pytest.approx(part.predicted.duration, rel=0.1)


@pytest.mark.long
def test_the_printed_round_is_driven(planner: Planner) -> None:
    planner.reset()
    (text,) = (
        printed.text
        for printed in commands()
        if printed.page == "team.md" and printed.text.startswith("ros2 action send_goal")
    )
    words = shlex.split(text)[3:]
    ran = run(sys.executable, str(ROOT / "examples" / "call.py"), *words, domain=planner.domain)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "steps of ann 1, bob 2" in ran.stdout


@pytest.mark.long
def test_what_a_robot_leaves_the_other_one_does(
    planner: Planner, shared: tuple[Processes, Client]
) -> None:
    planner.reset()
    sent = planner.send(goal([*map(station, [*LEFT, *RIGHT])], execute=True))
    planner.client.eventually(
        lambda: any(each.remaining > 0.0 for each in sent.feedback), "driving"
    )
    _, bob = shared[0].named("executor")
    bob.kill()
    result = sent.response(2 * PATIENCE).result
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    lost: list[TeamChain] = [each for each in result.chains if each.robot == "bob"]
    assert [each.outcome.code for each in lost] == [Outcome.INPUT_LOST]
    assert result.chains[-1].robot == "ann"
