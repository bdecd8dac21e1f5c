"""Experience with nodes that run already: `collect --over-ros --attach`."""

import io
import math
import os
import signal
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml
from chain_client import SentChain, call
from conftest import Start
from hall import Hall
from maps import hall as cells
from maps import write_map

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.bases.description import ConfigError
from ator_ros.bases.routes import routes_of
from ator_ros.domains.domain import find_domain
from ator_ros.experience.table import read_experience
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import LATCHED
from ator_ros.tools.collect import main
from ator_ros.tools.over_ros import Destinations, driven_tops

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
ATTACHED = ["--over-ros", "--attach"]


def places(folder: Path, *points: tuple[float, float]) -> Path:
    file = folder / "places.yaml"
    file.write_text(yaml.safe_dump([{"x": [x], "y": [y]} for x, y in points]), encoding="utf-8")
    return file


@pytest.mark.long
@pytest.mark.node
def test_drives_are_kept_on_interruption_and_the_same_command_goes_on(
    hall: Hall, start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(hall.client.domain))
    chains = hall.client.listen(ChainPerformance, "performance/chain", LATCHED)
    hall.base.set_pace(10.0)
    start("drive_to_server")
    table, points = tmp_path / "drives.parquet", ((1.0, 0.5), (-1.0, 0.0), (0.5, -1.0))
    words = [
        "--domain",
        str(tmp_path / "errands.yaml"),
        "--actions",
        "deliver",
        *ATTACHED,
        "--episodes",
        "3",
    ]
    words += ["--places", str(places(tmp_path, *points)), "--yes", "--out", str(table)]

    def interrupt() -> None:
        hall.client.eventually(lambda: chains, "a drive")
        driven = hall.base.received
        hall.client.eventually(lambda: hall.base.received > driven + 5, "the next drive")
        os.kill(os.getpid(), signal.SIGINT)

    waiting = threading.Thread(target=interrupt)
    waiting.start()
    assert main(words) == 130
    waiting.join()
    assert hall.base.commanded.linear.x == hall.base.commanded.angular.z == 0.0
    kept = read_experience(table).frame
    assert 1 <= len(kept) < 3
    assert main(words) == 0
    frame = read_experience(table).frame
    assert list(frame["episode"]) == [0, 1, 2]
    assert frame.head(len(kept)).equals(kept)
    assert frame["success"].all()
    assert set(zip(frame["xg"], frame["yg"], strict=True)) <= set(points)
    assert len(list(tmp_path.glob("drives.*"))) == 1


@pytest.mark.node
def test_a_goal_of_another_client_ends_the_drives(
    hall: Hall, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(hall.client.domain))
    server, sent, place = hall.serve(), list[SentChain](), Pose(1.0, 0.5, 0.3)

    def take_over() -> None:
        hall.client.eventually(lambda: server.goals, "a drive")
        sent.append(hall.chains.send([call("visit", place)]))
        hall.client.eventually(lambda: server.canceled, "its cancellation")
        hall.client.within(lambda: server.finish("canceled"))

    waiting = threading.Thread(target=take_over)
    waiting.start()
    words = [
        "--domain",
        str(tmp_path / "errands.yaml"),
        "--actions",
        "navigate",
        *ATTACHED,
        "--yes",
    ]
    assert main([*words, "--out", str(tmp_path / "drives.parquet")]) == 1
    waiting.join()
    assert "a newer goal took over; the same command resumes from here" in capfd.readouterr().err
    hall.reach(server, 2, place)
    assert sent[0].outcome().code == Outcome.SUCCEEDED


def test_the_robot_is_not_moved_without_confirmation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n"))
    file = write_map(tmp_path, cells())
    words = [
        "--domain",
        "tour",
        *ATTACHED,
        "--map",
        str(file),
        "--out",
        str(tmp_path / "drives.parquet"),
    ]
    assert main(words) == 1
    printed = capsys.readouterr().err
    assert "100 drives of courier to places in free space of hall.yaml" in printed
    assert "the robot was not moved" in printed
    assert not list(tmp_path.glob("drives.*"))
    with pytest.raises(SystemExit):
        main(["--domain", "tour", "--attach"])


@pytest.mark.parametrize("given", ["map", "places", "area"])
def test_goals_are_in_free_space_and_apart_from_the_robot(tmp_path: Path, given: str) -> None:
    file = places(tmp_path, (-2.0, 0.0), (2.0, 0.0)) if given == "places" else None
    robot = TOUR.on_map(write_map(tmp_path, cells())).robot() if given == "map" else ROBOT
    destinations, routes = Destinations(robot, file), routes_of(robot)
    spec, top = TOUR.actions()["drive_to"], driven_tops(TOUR, robot)["drive_to"]
    rng, pose, short = np.random.default_rng(3), Pose(-2.0, 0.0, 0.0), 0
    for _ in range(100):
        goal = destinations.goal(spec, top, pose, rng).pose
        assert given != "places" or (goal.x in (-2.0, 2.0) and goal.x != pose.x)
        if routes is not None:
            route = routes.between(*(np.array([value]) for value in (*pose[:2], *goal[:2])))
            assert math.isfinite(route.length[0])
            assert routes.clearance(np.array([goal.x]), np.array([goal.y]))[0] >= ROBOT.half_width
            short += goal.distance(pose) < 0.5
        pose = goal
    assert given != "map" or 5 <= short <= 30  # one drive in seven


def test_a_place_in_an_obstacle_is_reported_first(tmp_path: Path) -> None:
    robot = TOUR.on_map(write_map(tmp_path, cells())).robot()
    with pytest.raises(
        ConfigError, match=r"places\.yaml: \[1\]: expected a place in free space of the map"
    ):
        Destinations(robot, places(tmp_path, (-2.0, 0.0), (0.0, 0.0)))
