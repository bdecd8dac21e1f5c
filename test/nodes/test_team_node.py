"""The node `team` of the robot ann, with teammates whose messages the tests publish."""

import math
import time
from collections.abc import Iterator

import pytest
from action_servers import Server
from conftest import Host, Start
from nav_msgs.msg import Odometry
from process import PATIENCE
from profiles import assert_profile
from ros_client import Client

from ator_interfaces.msg import Outcome, Role, Roles, Teammate
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import object_odometry_of, odometry_of, situation_of
from ator_ros.nodes.parameters import SetupError
from ator_ros.nodes.qos import LATCHED, LATCHED_BY_MANY, NEWEST
from ator_ros.nodes.team import TEAMMATES
from ator_ros.resources import resource_path
from ator_ros.world.state import ObjectState, RobotState, World

CLIENT = {"namespace": "ann"}
ROLES = resource_path("config") / "team" / "soccer.yaml"
SETTINGS = {"roles": ROLES, "domain": "soccer"}
BALL = ObjectState(0.0, 0.0)
HERE = Pose(-2.0, 0.0, 0.0)
NEAR = Pose(-0.8, 0.0, 0.0)
TOPS = ["goToBall", "dribbleBall", "shoot"]
REACH = 0.3  # m
FAST, SLOW = 2.0, 12.0
"""Costs in s of the role ball; the robot ann needs about 9.5 s."""
SUPPORT = 3.0
"""Cost in s of the role support."""
PERIOD = 0.05


class Field:
    """The robot ann with its odometry and its executor, and a teammate."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.server = Server(client.node, "execute_chain")
        self.states = client.listen(Teammate, TEAMMATES, LATCHED_BY_MANY)
        self.beliefs = client.listen(Roles, "roles", LATCHED_BY_MANY)
        self._mates = client.node.create_publisher(Teammate, TEAMMATES, LATCHED)
        self._odom = client.node.create_publisher(Odometry, "odom", NEWEST)
        self._ball = client.node.create_publisher(Odometry, "ball", NEWEST)
        self._time = 100.0
        self.mate: Teammate | None = None
        client.node.create_timer(PERIOD, self._publish)

    def _publish(self) -> None:
        self._time += PERIOD
        self._ball.publish(object_odometry_of(self._time, BALL, frame="odom", height=0.1))
        robot = RobotState(HERE)
        self._odom.publish(odometry_of(self._time, robot, frame="odom", child="base_link"))
        if self.mate is not None:
            self._mates.publish(self.mate)

    def appears(self, cost: float, name: str = "bob", role: str = "", stamp: float = 1e6) -> None:
        """Let a teammate publish what the role ball costs it in s, by a clock of its own."""
        world = World(stamp, RobotState(NEAR), {"ball": BALL})
        costs = {"ball": cost, "support": SUPPORT}
        self.mate = Teammate(
            name=name,
            situation=situation_of(world, frame="odom"),
            reach=REACH,
            ready=True,
            role=role,
            roles=[
                Role(robot=name, role=each, cost=costs[each], uncertainty=0.2) for each in costs
            ],
        )

    def role(self) -> str:
        """Return the role that ann publishes."""
        own = [each for each in list(self.states) if each.name == "ann"]
        return own[-1].role if own else ""

    def wait_for(self, role: str) -> float:
        """Wait until ann publishes a role; return after how many real s."""
        start = time.monotonic()
        self.client.eventually(lambda: self.role() == role, f"the role {role or 'none'}")
        return time.monotonic() - start

    def tops(self) -> list[str]:
        """Return the TOPs of the newest goal of the executor; none if it is canceled."""
        if not self.server.goals or self.server.goals[-1].is_cancel_requested:
            return []
        return [call.top for call in self.server.goals[-1].request.chain.calls]


@pytest.fixture
def field(client: Client) -> Iterator[Field]:
    made = client.within(lambda: Field(client))
    yield made
    made.server.destroy()


def test_a_team_of_two_agrees_and_drives(field: Field, host: Host) -> None:
    host("team", "-r", "__ns:=/ann", execute=True, **SETTINGS)
    field.wait_for("ball")
    field.client.eventually(lambda: field.tops() == TOPS, "the chain of the role ball")
    pairs = {each.role: each for each in field.beliefs[-1].pairs}
    assert pairs["ball"].holds
    assert 0.0 < pairs["ball"].uncertainty < pairs["ball"].cost
    # A nearer robot does not take over if it is slower, and a faster one does, whatever its clock.
    field.appears(SLOW)
    field.client.eventually(lambda: len(field.beliefs[-1].pairs) > len(pairs), "two robots")
    time.sleep(0.5)
    assert field.role() == "ball"
    field.appears(FAST)
    field.wait_for("support")
    field.client.eventually(lambda: field.tops() == ["goToPose"], "the chain of support")
    found = {(each.robot, each.role) for each in field.beliefs[-1].pairs if each.holds}
    assert found == {("ann", "support"), ("bob", "ball")}
    costs = {each.role: each.cost for each in field.beliefs[-1].pairs if each.robot == "bob"}
    assert costs["ball"] == pytest.approx(FAST, abs=1.0)  # it is on its way since its message
    assert math.isnan(costs["keeper"])
    # It falls silent, comes back and is not ready.
    field.mate = None
    assert field.wait_for("ball") > 0.5
    field.appears(FAST, stamp=1e6 - 0.1)
    field.wait_for("support")
    assert field.mate is not None
    field.mate.ready = False
    field.wait_for("ball")
    field.client.eventually(lambda: field.tops() == TOPS, "the chain of the role ball again")
    # Without `execute` the chain is canceled, and the role goes on.
    assert field.client.set_parameters("/ann/team", execute=False)[0].successful
    field.client.eventually(lambda: not field.tops(), "a canceled chain")
    assert field.role() == "ball"
    assert_profile(field.client, "team", "ann")


def test_of_two_robots_with_one_role_the_later_one_by_name_leaves_it(
    field: Field, host: Host
) -> None:
    host("team", "-r", "__ns:=/ann", **SETTINGS)
    field.wait_for("ball")
    field.appears(SLOW, role="ball")
    time.sleep(1.0)
    assert field.role() == "ball"
    # The robot abe would need longer, but goes on.
    field.appears(SLOW, name="abe", role="ball")
    field.wait_for("support")
    assert not field.server.goals


def test_a_robot_whose_chain_failed_drops_out_for_a_while(field: Field, host: Host) -> None:
    node = host("team", "-r", "__ns:=/ann", execute=True, retry_after=2.0, **SETTINGS)
    field.client.eventually(lambda: field.server.goals, "a goal")
    field.server.finish("abort", code=Outcome.BASE_FAULT, reason="it does not follow")
    reason = "the chain of ball failed: it does not follow"
    field.client.eventually(lambda: reason in field.states[-1].status, "a failure")
    assert not field.states[-1].ready
    assert field.wait_for("ball") > 1.0
    assert node.running


def test_what_a_teammate_must_not_send_is_ignored(field: Field, host: Host) -> None:
    node = host("team", "-r", "__ns:=/ann", **SETTINGS)
    field.wait_for("ball")
    field.appears(FAST, role="king")
    field.client.eventually(lambda: "role: expected one of" in node.output, "a warning")
    field.appears(math.nan)
    field.client.eventually(lambda: "ball: cost: expected a finite" in node.output, "a third")
    field.appears(FAST)
    assert field.mate is not None
    field.mate.situation.header.frame_id = "moon"
    field.client.eventually(
        lambda: "expected the frame 'odom', got 'moon'" in node.output, "another"
    )
    assert field.role() == "ball"


@pytest.mark.parametrize(
    ("words", "parameters", "reason"),
    [
        ((), {"roles": ROLES}, "namespace: expected that of the robot"),
        (("-r", "__ns:=/ann"), {}, "parameter roles: expected a file, got none"),
        (("-r", "__ns:=/ann"), {"roles": "missing.yaml"}, "parameter roles: missing.yaml"),
    ],
)
def test_it_does_not_start_without_a_name_or_roles(
    host: Host, words: tuple[str, ...], parameters: dict[str, object], reason: str
) -> None:
    with pytest.raises(SetupError, match=reason):
        host("team", *words, **parameters)


@pytest.mark.long
def test_two_robots_play_in_one_simulation(start: Start, domain: int) -> None:
    client = Client(domain, "ann", frame="ann/odom")
    states = client.listen(Teammate, TEAMMATES, LATCHED_BY_MANY)
    start(
        "simulation", domain="soccer", robots="[ann, bob]",
        robot_start="[-1.5, 0.2, 0.0, -2.0, -1.3, 0.0]", lockstep=True, command_wait=0.5,
    )  # fmt: skip
    for name in ("ann", "bob"):
        frames = {"domain": "soccer", "frame": f"{name}/odom", "robot_frame": f"{name}/base_link"}
        start("executor", namespace=name, odom_timeout=5.0, **frames)
        start("team", namespace=name, roles=ROLES, **frames)
    client.eventually(lambda: {each.role for each in states[-6:]} == {"ball", "support"}, "roles")
    for name in ("ann", "bob"):
        assert client.set_parameters(f"/{name}/team", execute=True)[0].successful
    roles: dict[str, str] = {}
    overlap = [0.0]
    began: float | None = None

    def ball_is_carried() -> bool:
        nonlocal began
        while states:
            state = states.pop(0)
            roles[state.name] = state.role
            is_double = list(roles.values()).count("ball") > 1
            began = (began or time.monotonic()) if is_double else None
        if began is not None:
            overlap.append(time.monotonic() - began)
        ball = client.ball()
        return math.hypot(ball.x, ball.y) > 1.0

    client.eventually(ball_is_carried, "a ball that is carried", 3 * PATIENCE)
    client.close()
    assert roles == {"ann": "ball", "bob": "support"}
    assert max(overlap) < 2.0  # 0.5 s, and what a busy machine adds
