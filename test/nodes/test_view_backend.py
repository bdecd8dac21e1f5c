"""The view's backend with mock nodes and real nodes."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from chain_client import ChainClient, chain_of_the_paper
from conftest import Start
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, GoalResponse
from ros_client import Client
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, Outcome, Performance, Roles
from ator_interfaces.srv import PlaceObject, PlaceRobot, RefineSubgoal
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.trials import random_trial
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import chain_of, object_odometry_of, odometry_of
from ator_ros.nodes.network import NodesError
from ator_ros.nodes.qos import LATCHED, NEWEST, RESULTS, SERVICES
from ator_ros.nodes.simulation import transform_of
from ator_ros.view.backend import Backend
from ator_ros.view.draft import Draft
from ator_ros.view.editor import NAIVE, REFINED, Editor
from ator_ros.view.runs import Run
from ator_ros.world.state import ObjectState, RobotState, World

_PERIOD = 0.05
_FLOOR = 4.0
_OFF = 0.1


class MockNodes:
    """Mocks of simulation, refinement, and an executor whose goals never end.

    With `from_tf` the robot's state is on tf only, as the executor reports. `accepts` is whether
    the executor accepts goals.
    """

    def __init__(self, domain: int, *, from_tf: bool = False) -> None:
        self.paused, self.robot = False, Pose(0.5, 0.25, 1.0)
        self._ball: tuple[float, float] | None = None
        self._time, self._from_tf, self._sign = 0.0, from_tf, 1.0
        self.accepts = False
        self.answer = RefineSubgoal.Response()
        self._goals: list[Any] = []
        self._own = Client(domain, name="executor", silent=True)
        node = self._own.node
        node.declare_parameter("robot_from", "tf" if from_tf else "odom")
        node.declare_parameter("robot_frame", "base")
        node.declare_parameter("frame", "odom")
        for kind, name, answer in (
            (PlaceRobot, "place_robot", self._place_robot),
            (PlaceObject, "place_ball", self._place_ball),
            (SetBool, "pause", self._pause),
            (RefineSubgoal, "refine_subgoal", lambda *_: self.answer),
        ):
            node.create_service(kind, name, answer, qos_profile=SERVICES)
        self._server = self._serve()
        self._odom = node.create_publisher(Odometry, "odom", NEWEST)
        self._balls = node.create_publisher(Odometry, "ball", NEWEST)
        self._tf = node.create_publisher(TFMessage, "/tf", RESULTS)
        self.beliefs = node.create_publisher(Roles, "roles", LATCHED)
        self._status = node.create_publisher(ChainPerformance, "chain_under_way", LATCHED)
        node.create_timer(_PERIOD, self._publish)
        self.close = self._own.close

    def report(self, status: ChainPerformance) -> None:
        """Report the goal of another client."""
        self._status.publish(status)

    def vanish(self) -> None:
        """Offer no action any more, as an executor that has ended."""
        self._goals.clear()
        self._own.within(self._server.destroy)

    def restart(self) -> None:
        """Offer the action without the former goals, as an executor that was restarted."""
        self._goals.clear()
        self._own.within(self._serve)

    def _serve(self) -> ActionServer:
        answers = (GoalResponse.REJECT, GoalResponse.ACCEPT)
        return ActionServer(
            self._own.node, ExecuteChain, "execute_chain", lambda _: None,
            goal_callback=lambda _: answers[self.accepts],
            handle_accepted_callback=self._goals.append,
        )  # fmt: skip

    def _publish(self) -> None:
        for goal in self._goals:
            name = bytes(goal.goal_id.uuid).hex()
            self._status.publish(
                ChainPerformance(chain_id=name, outcome=Outcome(reason="executing"))
            )
        self._time += 0.0 if self.paused else _PERIOD
        if self._from_tf:
            transform = transform_of(self._time, self.robot, frame="odom", child="base")
            self._tf.publish(TFMessage(transforms=[transform]))
        else:
            message = odometry_of(self._time, RobotState(self.robot), frame="odom", child="base")
            self._odom.publish(message)
        if self._ball is not None:
            self._sign = -self._sign  # noise with a constant absolute error
            noisy = ObjectState(self._ball[0] + self._sign * _OFF, self._ball[1])
            self._balls.publish(object_odometry_of(self._time, noisy, frame="odom", height=0.1))

    def _place_robot(self, request: PlaceRobot.Request, response: Any) -> Any:
        at = request.pose.pose.position
        response.success, response.message = abs(at.x) < _FLOOR, "off the floor"
        if response.success:
            self.robot = Pose(at.x, at.y, 0.0)
        return response

    def _place_ball(self, request: PlaceObject.Request, response: Any) -> Any:
        at = request.position.point
        response.success, response.message = abs(at.x) < _FLOOR, "off the floor"
        if response.success:
            self._ball = None if request.remove else (at.x, at.y)
        return response

    def _pause(self, request: SetBool.Request, response: Any) -> Any:
        self.paused = request.data
        response.success = True
        return response


ROBOT = SOCCER.robot()
TRIAL = random_trial(SOCCER, "dribble", SOCCER.library(ROBOT), seed=0, index=0)
DRAFT = Draft(TRIAL.world, TRIAL.chain, "default")
PLACES = World(0.0, RobotState(Pose(1.0, 1.0, 0.0)), {"ball": ObjectState(-1.0, 0.5)})
PATIENCE = 240.0
BUSY = {"odom_timeout": 10.0, "refinement_timeout": 20.0, "start_timeout": 30.0}
"""Executor parameters for a busy machine."""
START = Pose(0.3, 2.0, -1.6)
"""A start from which the straight path to the ball is not the best."""
STARTS = {"ann": Pose(-2.0, 0.0, 0.0), "bob": Pose(1.0, -1.5, 3.0)}


def until(happened: Callable[[], object], what: str, step: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, f"expected {what}"
        step()


def steps(editor: Editor, happened: Callable[[], object], what: str, *others: Backend) -> None:
    """Step the editor until something has happened.

    Its robot's messages are taken, and those of others.
    """

    def step() -> None:
        for backend in (editor.backend, *others):
            assert isinstance(backend, Backend)
            backend.spin(0.02)
        editor.step()

    until(happened, what, step)


def attached(backend: Backend) -> Editor:
    editor = Editor(backend)
    editor.select(backend)
    steps(editor, lambda: editor.answer is not None, "an answer")
    return editor


# With mock nodes

Mocked = tuple[Backend, MockNodes]


@pytest.fixture
def mocked(domain: int, request: pytest.FixtureRequest) -> Iterator[Mocked]:
    """Yield a backend and mock nodes; with the parameter `tf` the robot's state is on tf."""
    with ExitStack() as closing:
        nodes = MockNodes(domain, from_tf=getattr(request, "param", "odom") == "tf")
        closing.callback(nodes.close)
        backend = Backend(SOCCER, ROBOT, ros_domain=domain, timeout=20.0)
        closing.callback(backend.close)
        backend.ready(simulated=False)
        assert backend.can_place
        yield backend, nodes


@pytest.mark.long
def test_a_noisy_object_does_not_delay_the_start(mocked: Mocked) -> None:
    backend, nodes = mocked
    backend.place(PLACES)
    world = backend.world()
    assert world.robot.pose == PLACES.robot.pose
    assert world.objects["ball"].x == pytest.approx(-1.0, abs=0.11)
    assert nodes.paused
    backend.pause(paused=False)
    assert not nodes.paused


def test_time_resumes_after_a_failed_start_and_at_the_end(mocked: Mocked) -> None:
    backend, nodes = mocked
    backend.place(PLACES)
    with pytest.raises(NodesError, match="the executor rejected the goal"):
        backend.execute(Run(NAIVE), DRAFT, refine=False)
    until(
        lambda: not nodes.paused, "time to go on after a refused goal", lambda: backend.spin(0.02)
    )
    with pytest.raises(NodesError, match="off the floor"):
        backend.place(World(0.0, RobotState(Pose(9.0, 0.0, 0.0))))
    until(
        lambda: not nodes.paused, "time to go on after a refused start", lambda: backend.spin(0.02)
    )
    backend.pause(paused=True)
    backend.close()
    assert not nodes.paused


@pytest.mark.parametrize(
    ("event", "problem"),
    [(MockNodes.vanish, "got none"), (MockNodes.restart, "the executor was restarted")],
)
def test_a_chain_whose_executor_has_gone_is_lost(
    mocked: Mocked, event: Callable[[MockNodes], None], problem: str
) -> None:
    backend, nodes = mocked
    nodes.accepts = True
    run = Run(NAIVE)
    backend.execute(run, DRAFT, refine=False)
    backend.spin(0.1)
    event(nodes)
    until(lambda: run.ended, "the end", lambda: backend.spin(0.02))
    assert problem in run.status
    backend.stop()  # no chain is active any more


@pytest.mark.long
def test_an_interruption_waits_for_the_message_under_way(mocked: Mocked) -> None:
    backend, done = mocked[0], list[int]()

    def interrupted() -> None:
        signal.raise_signal(signal.SIGINT)
        done.append(1)

    timer = backend.node.create_timer(0.01, interrupted)
    with pytest.raises(KeyboardInterrupt):
        backend.spin(PATIENCE)
    timer.cancel()
    assert done == [1]


@pytest.mark.parametrize("mocked", ["tf"], indirect=True)
def test_a_robot_on_tf_is_observed(mocked: Mocked) -> None:
    backend, nodes = mocked
    until(lambda: backend.world() is not None, "the robot", lambda: backend.spin(0.02))
    world = backend.world()
    assert world.robot.pose.distance(nodes.robot) < 1e-6
    assert backend.state_age() < 5.0


def test_the_role_in_a_team_is_known(mocked: Mocked) -> None:
    backend, nodes = mocked
    assert not backend.role
    nodes.beliefs.publish(Roles(robot="ann", role="ball"))
    until(lambda: backend.role == "ball", "the role", lambda: backend.spin(0.02))


def test_orders_are_those_of_the_calls_as_sent(mocked: Mocked) -> None:
    backend, nodes = mocked
    sent, executed = (
        chain_of(chain, action_set="", frame="odom")
        for chain in (DRAFT.chain, DRAFT.chain.reordered((1, 0)))
    )
    nodes.answer = RefineSubgoal.Response(
        accepted=True,
        original=sent,
        chain=executed,
        order=[1, 0],
        original_order=[0, 1],
        best_order=[1, 0],
        before_actions=[Performance(duration=each) for each in (1.0, 2.0)],
        after_actions=[Performance(duration=each) for each in (3.0, 4.0)],
    )
    answer = backend.refine(DRAFT)
    assert (answer.naive.order, answer.chain.order) == ((0, 1), (1, 0))
    assert (answer.before, answer.after) == ((1.0, 2.0), (4.0, 3.0))

    status = ChainPerformance(chain_id="a" * 32, chain=executed, order=[1, 0])
    status.header.frame_id = status.start.header.frame_id = "odom"
    nodes.report(status)
    until(lambda: backend.external is not None, "the goal", lambda: backend.spin(0.02))
    assert [call.top for call in backend.external.draft.chain.calls] == [
        call.top for call in DRAFT.chain.calls
    ]


# With real nodes


@pytest.mark.long
def test_a_goal_of_another_client_is_followed_and_can_be_canceled(
    domain: int, start: Start, client: Client
) -> None:
    start("simulation", command_wait=10.0, real_time_factor=3.0)
    start("refinement", deadline=5.0)
    start("executor", **BUSY)
    backend = Backend(SOCCER, ROBOT, ros_domain=domain, start_timeout=PATIENCE, timeout=PATIENCE)
    backend.ready(simulated=False)
    editor = attached(backend)
    chains = ChainClient(client)
    client.place(robot=START, ball=(0.0, 0.0))
    sent = chains.send(chain_of_the_paper(), refine=True)
    steps(editor, lambda: backend.external is not None and backend.external.driven, "the chain")
    steps(editor, lambda: editor.answer is not None and editor.answer.refined, "its start")
    draft, answer = editor.draft, editor.answer
    assert draft.world.robot.pose.distance(START) < 0.1
    assert [call.top.name for call in answer.chain.calls] == ["goToBall", "dribbleBall", "shoot"]
    assert answer.naive != answer.chain
    assert answer.curves
    assert all(value > 0.0 for value in (*answer.before, *answer.after))
    steps(editor, sent.ended, "the end")
    record = sent.result().record
    steps(editor, lambda: not editor.executing, "the end in the view")
    [run] = editor.runs
    assert record.outcome.code == Outcome.SUCCEEDED
    assert run.duration == pytest.approx(record.actual.duration)
    assert run.actual == {each.step: each.actual.duration for each in record.actions}
    assert (answer.reason, answer.refined) == (record.refinement, record.refined)

    client.place(robot=START, ball=(0.0, 0.0))
    sent = chains.send(chain_of_the_paper(), refine=True)
    steps(editor, lambda: editor.executing, "the next chain")
    editor.step([editor.stop])
    assert sent.outcome().code == Outcome.CANCELED
    steps(editor, lambda: not editor.executing, "the end")

    editor.execute(NAIVE)
    steps(editor, lambda: editor.runs and editor.runs[-1].ended, "our chain")
    assert backend.external is None
    backend.close()


@pytest.mark.long
def test_two_robots_of_one_simulation_are_shown_moved_and_executed(
    domain: int, start: Start
) -> None:
    numbers = [value for pose in STARTS.values() for value in pose]
    start("simulation", robots="[ann, bob]", robot_start=f"{numbers}", command_wait=10.0)
    backends = {}
    with ExitStack() as closing:
        for name in STARTS:
            frame = f"{name}/odom"
            start("refinement", namespace=name, frame=frame, deadline=5.0)
            start("executor", namespace=name, frame=frame, robot_frame=f"{name}/base_link", **BUSY)
            backends[name] = Backend(
                SOCCER, ROBOT, frame=frame, ros_domain=domain,
                arguments=["--ros-args", "-r", f"__ns:=/{name}"],
                start_timeout=PATIENCE, timeout=PATIENCE / 4.0,
            )  # fmt: skip
            closing.callback(backends[name].close)
        for backend in backends.values():
            backend.ready(simulated=False)
            assert backend.can_place
        execute_two_robots(*backends.values())


def execute_two_robots(ann: Backend, bob: Backend) -> None:
    editor = attached(ann)
    for backend, pose in zip((ann, bob), STARTS.values(), strict=True):
        backend.spin(1.0)
        assert distance(backend, pose) < 0.02  # showing a robot does not move it
    editor.step([lambda: editor.move_object("ball", Pose(0.3, 0.6, 0.0))])
    for backend in (ann, bob):
        steps(
            editor, lambda backend=backend: is_ball_at(backend, 0.3, 0.6), "the ball for both", bob
        )
    editor.execute(REFINED)
    steps(editor, lambda: bool(editor.runs) and editor.runs[-1].ended, "ann's chain")
    assert editor.runs[-1].duration > 0.0, editor.runs[-1].status
    bob.spin(0.5)
    assert distance(ann, STARTS["ann"]) > 0.3
    assert distance(bob, STARTS["bob"]) < 0.05

    editor.select(bob)
    steps(editor, lambda: editor.answer is not None and not editor.problem, "an answer for bob")
    # ann is at the end of its chain: bob drives elsewhere.
    editor.step(
        [
            lambda: editor.move_object("ball", Pose(0.5, -1.0, 0.0)),
            lambda: editor.move_goal(1, Pose(2.0, -0.5, 0.3)),
        ]
    )
    editor.execute(NAIVE)
    steps(editor, lambda: bool(editor.runs) and editor.runs[-1].ended, "bob's chain")
    assert editor.runs[-1].duration > 0.0, editor.runs[-1].status
    steps(editor, lambda: bob.history.report().startswith("1 chains"), "bob's record", ann)
    assert ann.history.report().startswith("1 chains")


def distance(backend: Backend, pose: Pose) -> float:
    world = backend.world()
    return float("inf") if world is None else world.robot.pose.distance(pose)


def is_ball_at(backend: Backend, x: float, y: float) -> bool:
    world = backend.world()
    ball = None if world is None else world.objects.get("ball")
    return ball is not None and abs(ball.x - x) < 0.02 and abs(ball.y - y) < 0.02
