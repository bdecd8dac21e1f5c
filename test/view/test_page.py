"""The page, with clients that speak its protocol."""

import contextlib
import dataclasses
import math
import socket
from collections.abc import Iterator

import pytest
from websockets.exceptions import ConnectionClosed

pytest.importorskip("viser", reason="needs viser: docs/install.md")

from view.in_process import InProcessBackend, record_of
from view.viser_client import ViserClient, free_port

from ator_interfaces.msg import Outcome
from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import ORDER
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.segments import Label
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.view.draft import situation_draft
from ator_ros.view.editor import NAIVE, REFINED, Editor
from ator_ros.view.floor import LOOPBACK, Canvas, serve
from ator_ros.view.page import Page, clock_text, gate_text, robot_labels, rules_text, times_text
from ator_ros.view.runs import OTHERS, Run
from ator_ros.world.state import RobotState, World

ROBOT = SOCCER.robot()


class Shown:
    """An editor with its page and loop."""

    def __init__(self) -> None:
        self.backend, self.other = InProcessBackend(), InProcessBackend()
        self.editor = Editor(self.backend)
        self.other.observe(0.0, Pose(-1.0, 1.5, 0.5), (2.0, -0.5))
        robots = {"ann": self.backend, "bob": self.other}
        self.page = Page(self.editor, ROBOT, robot_urdf(ROBOT), {}, robots=robots, port=free_port())
        self._now = 0.0

    def step(self, rounds: int = 2) -> None:
        for _ in range(rounds):
            self._now += 1.0
            self.editor.step(self.page.take_commands())
            self.page.update(self._now)

    def join(self) -> ViserClient:
        return ViserClient(self.page.server.get_port())

    def move_ball(self, x: float, y: float) -> None:
        self.page.commands.put(lambda: self.editor.move_object("ball", Pose(x, y, 0.0)))
        self.step()


@pytest.fixture
def shown() -> Iterator[Shown]:
    shown = Shown()
    shown.step()
    yield shown
    shown.page.server.stop()


def test_texts_of_the_floor_are_replaced_as_a_whole(shown: Shown) -> None:
    canvas = Canvas(shown.page.server, "/round", ROBOT.scene.area)
    client = shown.join()
    canvas.label([Label("station0", "1 (2nd)", 1.0, 2.0), Label("station1", "2 (1st)", 0.0, 1.0)])
    client.until(lambda: client.scene.get("/round/station0"), "the label")
    assert client.scene["/round/station0"][:2] == (1.0, 2.0)
    canvas.label([Label("station1", "2", 0.5, 1.0)])
    client.until(lambda: "/round/station0" not in client.scene, "one label less")
    client.until(lambda: client.scene["/round/station1"][:2] == (0.5, 1.0), "the other one, moved")


def test_two_clients_receive_the_same_and_one_may_vanish(shown: Shown) -> None:
    first, second = shown.join(), shown.join()
    shown.move_ball(0.5, -1.0)
    for client in (first, second):
        client.until(
            lambda client=client: client.scene.get("/objects/ball") == (0.5, -1.0, 0.0), "the ball"
        )
    first.until(lambda: first.scene == second.scene, "the same scene")
    pose = shown.backend.state.robot.pose
    assert first.scene["/robots/ann"] == pytest.approx((pose.x, pose.y, 0.0), abs=1e-6)
    assert {"/chain/ring0", "/chain/naive/legs", "/goals/1"} <= set(first.scene)

    first.vanish()
    for step in range(10):
        shown.move_ball(0.1 * step, 1.0)
    second.until(
        lambda: second.scene["/objects/ball"] == pytest.approx((0.9, 1.0, 0.0)), "the ball, moved"
    )
    third = shown.join()
    third.until(lambda: third.scene == second.scene, "the same scene for a later client")
    assert shown.editor.problem == ""
    second.close()
    third.close()


def test_a_drag_keeps_the_offset_of_its_start(shown: Shown) -> None:
    client = shown.join()
    ball = shown.backend.state.objects["ball"]
    client.look()
    client.until(lambda: "/objects/ball" in client.scene, "the ball")
    client.drag("/objects/ball/body", ball.x + 0.05, ball.y, "start")
    client.drag("/objects/ball/body", ball.x + 1.05, ball.y)
    client.until(
        lambda: (
            shown.step()
            or shown.backend.state.objects["ball"].x == pytest.approx(ball.x + 1.0, abs=0.01)
        ),
        "the drag",
    )
    client.close()


def test_robots_of_a_team_have_their_roles_and_chains(shown: Shown) -> None:
    """Each with its name; a robot whose state is unknown has none."""
    ann = shown.backend
    assert [label.text for label in robot_labels({"ann": ann})] == ["ann"]
    ann.role = "ball"
    ann.external = Run(OTHERS, draft=shown.editor.draft)
    (label,) = robot_labels({"ann": ann})
    assert label.text == "ann: ball (goToBall, dribbleBall)"
    assert (label.x, label.y) == ann.world().robot.pose[:2]
    assert not robot_labels({"eve": Unobserved()})


class Unobserved(InProcessBackend):
    """A robot without odometry."""

    def world(self) -> None:
        """Return that no state is known."""


HOSTILE = [
    math.nan, math.inf, -math.inf, 1e308, -1e308, 2**63, -(2**63), -1, 0.5, None, True, "",
    "a\n\x1b[2J",
    1e-7, 5e-324,
    "x" * 100_000, b"x", [], [[]], [1.0, 2.0], {"a": 1}, "1e308",
]  # fmt: skip
"""Values that no field of the panel offers, except some for a few of them."""


def test_no_value_of_a_client_harms_the_page_of_others(shown: Shown) -> None:
    client = shown.join()
    client.look()
    client.until(lambda: "Seed" in client.labels and "Chain" in client.labels, "the panel")
    client.until(lambda: "/objects/ball" in client.scene, "the ball")
    chain = shown.editor.chain_name
    for label in ("Seed", "Number", "Chain", "Actions", "Robot", "duration"):
        for value in HOSTILE:
            if not (label == "duration" and value == 0.5):
                client.change(label, value=value)
    for name in ("update_cb", "sync_cb", "props", "removed", "label", "is_button", "unknown"):
        client.change("Seed", **{name: None})
    client.change("Seed", value=4, removed=True)
    client.send("GuiUpdateMessage", uuid="unknown", updates={"value": 1})
    client.change("duration", value=2.0)
    client.until(
        lambda: shown.step() or shown.editor.draft.weights == {"duration": 2.0}, "a weight"
    )
    for value in HOSTILE:
        attacker = shown.join()
        with contextlib.suppress(ConnectionClosed):  # the server ends some of these connections
            attacker.look()
            attacker.drag("/objects/ball/body", value, value)
            attacker.send("GuiUpdateMessage", uuid=[value], updates=value)
            attacker.send("FileTransferPart", content=value)
        attacker.close()
    shown.step()
    assert (shown.editor.seed, shown.editor.index, shown.editor.chain_name) == (0, 0, chain)
    assert shown.editor.backend is shown.backend
    ball = shown.backend.state.objects["ball"]
    assert math.hypot(ball.x, ball.y) < 10.0

    later = shown.join()
    later.until(lambda: later.scene == client.scene, "the same scene for a later client")
    later.until(lambda: later.text() == client.text(), "the same texts")
    client.close()
    later.look()
    later.change("Seed", value=7)
    later.until(lambda: shown.step() or shown.editor.seed == 7, "a valid seed")
    assert shown.editor.problem == ""
    later.close()


def test_a_client_with_an_impossible_camera_moves_nothing(shown: Shown) -> None:
    ball = shown.backend.state.objects["ball"]
    for place in HOSTILE:
        client = shown.join()
        with contextlib.suppress(ConnectionClosed):  # the server ends some of these connections
            if place not in (-1, 0.5, True):
                client.look((0.0, 0.0, place))
            client.drag("/objects/ball/body", 1.0, 1.0)
        client.close()
    later = shown.join()
    later.until(lambda: "duration" in later.labels, "the panel")
    later.look()
    later.change("duration", value=2.0)
    later.until(lambda: shown.step() or shown.editor.draft.weights, "a weight")
    assert shown.backend.state.objects["ball"] == ball
    later.close()


def test_several_robots_are_shown_and_one_is_chosen(shown: Shown) -> None:
    client = shown.join()
    client.until(
        lambda: client.scene.get("/robots/bob") == pytest.approx((-1.0, 1.5, 0.0)), "the other one"
    )
    shown.editor.execute(NAIVE)
    shown.page.commands.put(lambda: shown.editor.select(shown.other))
    shown.step()
    client.until(
        lambda: client.scene["/objects/ball"] == pytest.approx((2.0, -0.5, 0.0)), "the choice"
    )
    start = shown.backend.state.robot.pose
    client.until(
        lambda: client.scene["/robots/ann"] == pytest.approx((*start[:2], 0.0)), "the first one"
    )
    refined = shown.other.refined[-1]
    assert refined.world.robot.pose == Pose(-1.0, 1.5, 0.5)
    assert refined.chain.calls[0].goal.pose[:2] == (2.0, -0.5)
    assert shown.other.calls == []  # choosing a robot does not move it
    shown.move_ball(1.0, 1.0)
    assert shown.other.state.objects["ball"].x == 1.0
    assert shown.backend.state.objects["ball"].x != 1.0
    client.close()


def test_a_goal_of_another_client_is_drawn(shown: Shown) -> None:
    client = shown.join()
    draft = situation_draft(SOCCER, shown.backend.libraries["default"], "dribble", seed=3, index=1)
    record = record_of(
        2.5, duration=3.0, reason="executing", refined=True, refinement="gain of 1.2 s"
    )
    goal = Run(OTHERS, record, draft)
    shown.backend.external = goal
    before = client.drawn["/chain/ring0"]
    shown.step()
    for words in ("of others: executing", "gain of 1.2 s", "| others, driven | 2.50 |"):
        client.until(lambda words=words: words in client.text(), words)
    client.until(lambda: client.drawn["/chain/ring0"] > before, "the ring of another situation")
    assert {"/chain/naive/legs", "/chain/chain/legs", "/chain/ring0", "/chain/chosen0"} <= set(
        client.scene
    )
    for time in (1.0, 2.0):
        shown.backend.observe(time, Pose(0.1 * time, 0.0, 0.0), (1.0, 0.0))
    shown.step()
    client.until(lambda: "/trails/others" in client.scene, "the trail")
    client.close()


def test_a_round_is_shown_in_its_order_with_the_numbers_of_its_stations(shown: Shown) -> None:
    top = shown.backend.libraries["default"]["goToPose"]
    opened = frozenset({"yaw", ORDER})
    calls = [TopCall(top, Goal(Pose(x, 0.0, 0.0)), opened) for x in (2.0, 1.0)]
    draft = dataclasses.replace(shown.editor.draft, chain=TopChain(tuple(calls)))
    draft = draft.with_robot(Pose(0.0, 0.0, 0.0))
    shown.page.commands.put(lambda: shown.editor.edit(lambda _: draft))
    shown.step()
    answer = shown.editor.answer
    assert answer is not None
    assert answer.chain.order == (1, 0)
    client = shown.join()
    for name, x in (("station0", 2.0), ("station1", 1.0)):
        client.until(lambda n=name: client.scene.get(f"/chain/{n}"), name)
        assert client.scene[f"/chain/{name}"][:2] == (x, 0.0)
    client.close()
    driven = record_of(2.5, 1.5, code=Outcome.SUCCEEDED, duration=4.0)
    for action, step in zip(driven.actions, (1, 0), strict=True):
        action.step = step
    *_, naive, best, run = times_text(answer, [Run(REFINED, driven)]).splitlines()
    assert run == "| refined, driven | 1.50 | 2.50 | 4.00 |"
    # from the second station to the first one it is 1 m, from the start 2 m
    assert float(best.split("|")[2]) < float(naive.split("|")[2])


def test_a_port_in_use_is_skipped_and_a_foreign_host_rejected() -> None:
    with socket.create_server((LOOPBACK, 0)) as taken:
        port = taken.getsockname()[1]
        server = serve(SOCCER, ROBOT, port=port)
        assert server.get_port() > port
        assert server.get_host() == "127.0.0.1"
        assert server.request_share_url() is None  # clients do not get one either
        server.stop()
    with pytest.raises(
        OSError, match=r"expected an address of this machine, got '203\.0\.113\.7': "
    ):
        serve(SOCCER, ROBOT, host="203.0.113.7")


def test_the_panel_shows_times_reason_and_rules_of_the_situation() -> None:
    backend = InProcessBackend()
    editor = backend.editor()
    answer = editor.answer
    driven = record_of(4.5, code=Outcome.SUCCEEDED, duration=9.25)
    table = times_text(answer, [Run(NAIVE, driven)]).splitlines()
    assert table[0] == "| s | goToBall | dribbleBall | chain |"
    assert table[-1] == "| naive, driven | 4.50 | - | 9.25 |"
    assert gate_text(answer, "").startswith("gain ")
    assert gate_text(None, "no service") == "**not refined:** no service"
    text = rules_text(editor.draft.world, answer.chain, ROBOT, backend.refiner.models)
    assert text.count("here time = ") == 2
    predicted = float(text.split("here time = ")[1].split(" ")[0])
    assert predicted == pytest.approx(answer.after[0], abs=0.01)


def test_the_clock_reports_a_silent_robot() -> None:
    world = World(3.0, RobotState(Pose(0.0, 0.0, 0.0)))
    assert clock_text(world, 1.0, "drives", paused=False) == "**3.00 s** · drives"
    assert "no state of the robot for 7 s" in clock_text(world, 7.3, "drives", paused=False)
    assert clock_text(world, 7.3, "waits", paused=True) == "**3.00 s** (paused) · waits"
