"""The page of a recording, with clients that receive what a browser would."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from chain_recording import Messages, x_at
from free_port import free_port

pytest.importorskip("viser", reason="needs viser: docs/install.md")

from viser_client import ViserClient

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.streams import Rows, Streams, Track
from ator_ros.page.replay_page import ReplayPage
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.viewing.recorded import chain_of_record
from ator_ros.viewing.recording import RecordedRobot

ROBOT = SOCCER.robot()


def recorded(y: float) -> RecordedRobot:
    """Return a robot that drives along x for 8 s, with the ball before it and a chain from 1 s to 7 s."""
    odom = Rows(6, [(0.1 * n, x_at(0.1 * n), y, 0.0, 0.5, 0.0) for n in range(81)])
    streams = Streams(odom=odom, objects={"ball": Rows(3, [(0.0, 1.5, 0.5), (8.0, 1.5, 1.5)])})
    return RecordedRobot([Track(streams)], [(0, chain_of_record(Messages().chain()))])


@pytest.fixture
def page() -> Iterator[ReplayPage]:
    robots = {"ann": recorded(0.0), "bob": recorded(-1.0)}
    page = ReplayPage(robots, SOCCER, ROBOT, robot_urdf(ROBOT), port=free_port())
    yield page
    page.close()


def test_clients_see_the_recording_at_its_time(page: ReplayPage) -> None:
    first, second = (ViserClient(page.server.get_port()) for _ in range(2))
    page.update(0.0)
    page.update(4.0)
    for client in (first, second):
        client.until(lambda client=client: client.scene.get("/robot") == pytest.approx((0.0, 0.0, 0.0)), "it")
        client.until(lambda client=client: "/chain/chain/legs" in client.scene, "the chain")
        assert client.scene["/robots/1"] == pytest.approx((0.0, -1.0, 0.0))
        assert client.scene["/objects/ball"][:2] == pytest.approx((1.5, 1.0))
    first.vanish()
    page.inbox.put("Seconds", lambda: page.player.seek(7.5))
    page.update(4.0)
    second.until(lambda: second.scene["/robot"] == pytest.approx((1.75, 0.0, 0.0)), "what was chosen")
    second.until(lambda: "/chain/chain/legs" not in second.scene, "no chain after its end")

    page.inbox.put("Robot", lambda: page.choose("bob"))
    page.update(4.0)
    second.until(lambda: second.scene["/robot"] == pytest.approx((1.75, -1.0, 0.0)), "the other robot, then")
    assert second.scene["/robots/0"] == pytest.approx((1.75, 0.0, 0.0))

    page.inbox.put("Robot", lambda: page.choose("nobody"))
    page.inbox.put("Seconds", lambda: page.player.seek("late"))  # type: ignore[arg-type]
    page.inbox.put("back", lambda: page.player.seek(-math.nan))
    page.update(4.0)
    second.until(lambda: second.scene["/robot"] == pytest.approx((x_at(0.0), -1.0, 0.0)), "the begin")
    second.close()
