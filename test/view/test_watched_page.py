"""The page beside Nav2, with a client that speaks its protocol: what it shows of watched drives."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("viser", reason="needs viser: docs/install.md")

from view.viser_client import ViserClient, free_port

from ator_interfaces.msg import DriveEstimate, Gain, Saving, WatchedDrives
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.learning.watch_tally import Tally
from ator_ros.view.watched import Watched, WatchedPage, errors_over_time, report_text

BUILDING = find_domain("building")
UNKNOWN = Saving(saving=math.nan, low=math.nan, high=math.nan)
REPORT = WatchedDrives(
    server="navigate_to_pose", drives=70, held_up=2, recovered=1, ended_early=3, models="1f0c",
    estimated=50, estimate_error=0.31, server_error=4.9, driven=7800.0,
    refined=Gain(refined=12, measured=1.5, measured_low=0.5, measured_high=2.5),
    headings=Saving(saving=4.0, low=2.0, high=6.0), passing=UNKNOWN,
    order=Saving(saving=310.0, low=250.0, high=370.0),
)  # fmt: skip


@pytest.fixture
def page() -> Iterator[WatchedPage]:
    made = WatchedPage(BUILDING, BUILDING.robot(), port=free_port())
    yield made
    made.server.stop()


def test_it_shows_drives_estimates_rules_and_savings(page: WatchedPage) -> None:
    estimate = DriveEstimate(goal_id="ab", remaining=12.4, spread=0.6)
    estimate.goal.pose.position.x = 2.0
    drive = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0)])
    client = ViserClient(page.server.get_port())
    page.update(Watched(Pose(1.0, 0.5, 0.0), REPORT, [estimate], [drive], rules="duration = 2"))
    client.until(lambda: "70 drives to learn from" in client.text(), "the report")
    client.until(lambda: "/drives/drive0" in client.scene, "a drive")
    area = BUILDING.robot().scene.area
    place = (1.0 - area.x, 0.5 - area.y, 0.0)
    client.until(lambda: client.scene.get("/robot") == pytest.approx(place), "the robot")
    assert "/goals/goalab" in client.scene
    assert "duration = 2" in client.text()
    assert "| order | 310.0 s | 250.0 to 370.0 |" in client.text()

    page.update(Watched(None, REPORT))
    client.until(lambda: "/goals/goalab" not in client.scene, "no estimate after the drive")
    client.close()


def test_what_is_unknown_is_said_to_be() -> None:
    assert "| passing | unknown | - |" in report_text(REPORT)
    assert "1.5 s (0.5 to 2.5)" in report_text(REPORT)
    assert "Models: none yet" in report_text(
        WatchedDrives(refined=Gain(), headings=UNKNOWN, passing=UNKNOWN, order=UNKNOWN)
    )


def test_errors_are_those_of_the_newest_drives() -> None:
    tally = Tally(estimate_errors=[0.5, 0.2, 0.1], server_errors=[4.0, 5.0])
    numbers, ours, theirs = errors_over_time(tally)
    assert numbers.tolist() == [1.0, 2.0, 3.0]
    assert ours.tolist() == [0.5, 0.2, 0.1]
    assert math.isnan(theirs[0])
    assert theirs[1:].tolist() == [4.0, 5.0]
    assert [each.shape for each in errors_over_time(Tally())] == [(1,)] * 3
