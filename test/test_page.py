"""The page, with clients that receive what a browser would; `nodes/test_view_browser.py` uses a browser."""

from __future__ import annotations

import gc
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator

import pytest
from free_port import free_port
from in_process_stage import InProcessStage

pytest.importorskip("viser", reason="needs viser: docs/install.md")

from viser_client import ViserClient

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.page.page import Page
from ator_ros.page.serving import LOOPBACK, served
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.viewing.desk import Desk
from ator_ros.viewing.guest import OTHERS, Guest
from ator_ros.viewing.runs import Run
from ator_ros.viewing.situations import drawn

ROBOT = SOCCER.robot()


class Shown:
    """A desk with its page, and the loop that joins them."""

    def __init__(self) -> None:
        self.stage = InProcessStage(SOCCER, ROBOT)
        self.desk = Desk(self.stage, SOCCER, self.stage.libraries)
        self.other = InProcessStage(SOCCER, ROBOT)
        self.other.place_robot(Pose(-1.0, 1.5, 0.5))
        self.other.place_object("ball", 2.0, -0.5)
        stages = {"ann": self.stage, "bob": self.other}
        self.page = Page(self.desk, ROBOT, robot_urdf(ROBOT), {}, port=free_port(), stages=stages)
        self._now = 0.0

    def go_on(self, rounds: int = 2) -> None:
        for _ in range(rounds):
            self._now += 1.0
            self.desk.step(self.page.inbox.take())
            self.page.update(self._now)

    def join(self) -> ViserClient:
        return ViserClient(self.page.server.get_port())


@pytest.fixture
def shown() -> Iterator[Shown]:
    shown = Shown()
    shown.go_on()
    yield shown
    shown.page.close()


def move_ball(shown: Shown, x: float, y: float) -> None:
    """Do what a drag of the ball does, whoever drags."""
    shown.page.inbox.put(("object", "ball"), lambda: shown.desk.move_object("ball", x, y))
    shown.go_on()


def test_two_clients_see_the_same_and_one_that_disappears_does_no_harm(shown: Shown) -> None:
    first, second = shown.join(), shown.join()
    move_ball(shown, 0.5, -1.0)
    for client in (first, second):
        client.until(lambda client=client: client.scene.get("/objects/ball") == (0.5, -1.0, 0.0), "the ball")
    first.until(lambda: first.scene == second.scene, "the same scene")
    pose = shown.stage.state.robot.pose
    assert first.scene["/robot"] == pytest.approx((pose.x, pose.y, 0.0), abs=1e-6)
    assert {"/chain/ring0", "/chain/naive/legs", "/goals/1"} <= set(first.scene)

    first.vanish()
    for step in range(10):
        move_ball(shown, 0.1 * step, 1.0)
    second.until(lambda: second.scene["/objects/ball"] == pytest.approx((0.9, 1.0, 0.0)), "the ball, moved")
    third = shown.join()
    third.until(lambda: third.scene == second.scene, "the same scene for who comes later")
    assert shown.desk.problem == ""
    second.close()
    third.close()


def test_what_no_browser_sends_is_told_in_one_line_and_the_page_goes_on(
    shown: Shown, caplog: pytest.LogCaptureFixture
) -> None:
    client = shown.join()
    client.look()
    client.set("Seed", [1, 2])
    client.set("Time", "yesterday")
    client.set("Number", 2)
    client.until(lambda: shown.page.inbox.take() != [], "the number")
    gc.collect()  # asyncio tells of errors of tasks that are gone
    client.until(lambda: "ignored what a client sent" in caplog.text, "the line")
    assert all(record.exc_info is None for record in caplog.records)
    client.close()


@pytest.mark.parametrize("place", [(1.0, 2.0), {}, [[1.0]], (1e300, 1e300, 1e300)])
def test_a_drag_to_what_is_no_place_moves_nothing(
    shown: Shown, place: object, capfd: pytest.CaptureFixture[str]
) -> None:
    client = shown.join()
    client.look()
    client.until(lambda: "/objects/ball" in client.scene, "the ball")
    client.point("/objects/ball/body", place, "update")
    client.set("Number", 2)
    wishes: list[object] = []
    client.until(lambda: wishes.extend(shown.page.inbox.take()) or wishes, "the number")
    assert len(wishes) == 1
    assert "Traceback" not in capfd.readouterr().err
    client.close()


def test_two_clients_that_drag_the_same_thing_pull_where_each_took_hold(shown: Shown) -> None:
    first, second = shown.join(), shown.join()
    ball = shown.stage.state.objects["ball"]
    for client, off in ((first, 0.05), (second, -0.05)):
        client.look()
        client.until(lambda client=client: "/objects/ball" in client.scene, "the ball")
        client.drag("/objects/ball/body", ball.x + off, ball.y, "start")
        client.until(lambda: shown.page.inbox.take() != [], "the hold")
    for client, off in ((first, 0.05), (second, -0.05)):
        client.drag("/objects/ball/body", ball.x + 1.0 + off, ball.y)
        wishes: list[Callable[[], None]] = []
        client.until(lambda wishes=wishes: wishes.extend(shown.page.inbox.take()) or wishes, "the drag")
        shown.desk.step(wishes)
        assert shown.stage.state.objects["ball"].x == pytest.approx(ball.x + 1.0, abs=0.01)
        shown.desk.step([lambda: shown.desk.move_object("ball", ball.x, ball.y)])
        shown.go_on()
    first.close()
    second.close()


class Contested(deque[object]):
    """Waiting clients, of which one comes or goes whenever another thread looks at them."""

    def __iter__(self):  # type: ignore[no-untyped-def]
        if threading.current_thread() is threading.main_thread():
            raise RuntimeError("deque mutated during iteration")
        return super().__iter__()


def test_clients_that_come_and_go_while_something_is_sent_do_no_harm(shown: Shown) -> None:
    event = shown.page.server._websock_server.get_message_buffer().message_event
    client = shown.join()
    client.until(lambda: "/objects/ball" in client.scene, "the ball")
    event._waiters = Contested(event._waiters)  # type: ignore[assignment]
    move_ball(shown, 0.25, -1.0)
    client.until(lambda: client.scene.get("/objects/ball") == (0.25, -1.0, 0.0), "the ball, moved")
    client.close()


def test_of_several_robots_all_are_shown_and_one_is_chosen(shown: Shown) -> None:
    client = shown.join()
    client.until(lambda: client.scene.get("/robots/bob") == pytest.approx((-1.0, 1.5, 0.0)), "the other one")
    shown.desk.play("naive")
    shown.page.inbox.put("Robot", lambda: shown.desk.control(shown.other))
    shown.go_on()
    client.until(lambda: client.scene["/robot"] == pytest.approx((-1.0, 1.5, 0.0)), "it is chosen")
    start = shown.stage.state.robot.pose
    client.until(lambda: client.scene["/robots/ann"] == pytest.approx((*start[:2], 0.0)), "the first one")
    assert client.scene["/objects/ball"] == pytest.approx((2.0, -0.5, 0.0))
    # What is asked and placed from now on concerns it, from where it is; nothing was moved by choosing it.
    asked = shown.other.asked[-1]
    assert asked.world.robot.pose == Pose(-1.0, 1.5, 0.5)
    assert asked.chain.calls[0].goal.pose[:2] == (2.0, -0.5)
    assert shown.other.calls == []
    move_ball(shown, 1.0, 1.0)
    assert shown.other.state.objects["ball"].x == 1.0
    assert shown.stage.state.objects["ball"].x != 1.0
    client.close()


def test_a_chain_of_others_is_drawn_and_told(shown: Shown) -> None:
    client = shown.join()
    draft = drawn(SOCCER, shown.stage.libraries, "dribble", seed=3, index=1)
    guest = Guest("a" * 32, draft, Run(OTHERS), begun=True, refined=True, reason="gain of 1.2 s")
    guest.run.actual.append(2.5)
    guest.run.status = "of others: executing"
    shown.stage.guest = guest
    before = client.drawn["/chain/ring0"]
    shown.go_on()
    for words in ("of others: executing", "**refined:** gain of 1.2 s", "| others, driven | 2.50 |"):
        client.until(lambda words=words: words in client.text(), words)
    client.until(lambda: client.drawn["/chain/ring0"] > before, "the ring of another situation")
    assert {"/chain/naive/legs", "/chain/chain/legs", "/chain/ring0", "/chain/chosen0"} <= set(client.scene)
    shown.go_on()
    client.until(lambda: "/trails/others" in client.scene, "the trail")
    client.close()


def test_a_port_that_is_taken_is_passed_over() -> None:
    with socket.create_server((LOOPBACK, 0)) as taken:
        port = taken.getsockname()[1]
        server = served(SOCCER, ROBOT, port=port)
        assert server.get_port() > port
        server.stop()


def test_where_no_page_can_be_served_is_told() -> None:
    with pytest.raises(OSError, match=r"expected an address of this machine, got '203\.0\.113\.7': "):
        served(SOCCER, ROBOT, host="203.0.113.7")
    for nothing in ("x" * 70, "\x00"):
        with pytest.raises(OSError, match="expected an address of this machine"):
            served(SOCCER, ROBOT, host=nothing)
    with socket.create_server((LOOPBACK, 65535)), pytest.raises(OSError, match="a free port from 65535 on"):
        served(SOCCER, ROBOT, port=65535)
