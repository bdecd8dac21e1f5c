"""The view's page in a headless Chromium, with the nodes that the view starts."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from ros_client import Client
from view.chromium import Chromium, need_browser
from view.view_camera import canvas_of, red_around, seen_at

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.trials import random_trial
from ator_ros.geometry import Pose
from ator_ros.world.state import ObjectState

pytestmark = [pytest.mark.node, pytest.mark.long]
ROBOT = SOCCER.robot()
START = random_trial(SOCCER, "dribble", SOCCER.library(ROBOT), seed=0, index=0).world
TARGET = (0.5, 1.0)


def off(pose: Pose | ObjectState, x: float, y: float) -> float:
    return math.hypot(pose.x - x, pose.y - y)


@pytest.fixture(autouse=True)
def browser_is_there(request: pytest.FixtureRequest) -> None:
    need_browser(request)


@pytest.fixture
def view() -> Iterator[tuple[str, int]]:
    """Yield the page's address and the nodes' ROS domain."""
    command = [str(Path(get_package_prefix("ator_ros"), "lib", "ator_ros", "view")), "--port", "18231"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ})
    assert process.stdout is not None
    try:
        domain = re.search(r"domain (\d+)", process.stdout.readline())
        address = re.search(r"http://\S+", process.stdout.readline())
        assert domain
        assert address
        yield address[0], int(domain[1])
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0


def test_the_page_shows_the_robot_drags_the_ball_and_runs_a_race(
    view: tuple[str, int], tmp_path: Path
) -> None:
    address, domain = view
    watch = Client(domain, steers=False)
    profile = tmp_path / "profile"
    profile.mkdir()
    with Chromium(profile, address) as browser:
        browser.until(lambda: "Race" in browser.text() and "best, predicted" in browser.text(), "the panel")
        browser.until(lambda: off(watch.robot().pose, *START.robot.pose[:2]) < 0.02, "the robot at its start")
        canvas, radius = canvas_of(browser), ROBOT.scene.radius("ball")
        robot = seen_at(ROBOT, (*START.robot.pose[:2], 0.1), canvas)
        elsewhere = seen_at(ROBOT, (0.0, -2.0, 0.1), canvas)
        browser.until(lambda: red_around(browser.picture(), robot) > 0.02, "the robot where odometry says")
        assert red_around(browser.picture(), elsewhere) == 0.0

        ball = START.objects["ball"]
        before = browser.text()
        browser.drag(
            seen_at(ROBOT, (ball.x, ball.y, radius), canvas), seen_at(ROBOT, (*TARGET, radius), canvas)
        )
        browser.until(lambda: off(watch.ball(), *TARGET) < 0.1, "the ball where it was dragged to")
        browser.until(lambda: browser.text() != before and "refined:" in browser.text(), "new predictions")

        browser.press("Race")
        verdict = r"naive (\d+\.\d\d) s, refined (\d+\.\d\d) s: gain"
        browser.until(lambda: re.search(verdict, browser.text()), "two times")
        times = re.search(verdict, browser.text())
        assert times is not None
        assert 0.0 < float(times[2]) < float(times[1])

        browser.click("History")
        browser.until(lambda: "2 chains, 1 of them refined" in browser.text(), "the history")
        gain = re.search(r"same start: \+(\d+\.\d\d) s, mean of 1", browser.text())
        assert gain is not None
        assert float(gain[1]) == pytest.approx(float(times[1]) - float(times[2]), abs=0.011)
    watch.close()
