"""A planner server, such as Nav2's, whose paths are the routes of refinement and of training."""

import importlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import numpy as np
import pytest
import yaml
from action_msgs.srv import CancelGoal
from arena import LONG_START
from chain_client import call
from conftest import Host
from experience_rows import route_drives
from geometry_msgs.msg import PoseStamped
from maps import hall_map
from nav2_interfaces import provide_nav2_msgs
from process import Process
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from refinement_requests import refine
from ros_client import Client

from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import find_domain
from ator_ros.experience.table import Experience, write_experience
from ator_ros.geometry import Pose
from ator_ros.learning.sets import Manifest, new_set_folder, publish, seal
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.parameters import SetupError
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.training import train
from ator_ros.world.grid_map import save_map
from ator_ros.world.readers import pose_from

pytestmark = pytest.mark.node
WALL = hall_map("map.yaml")
DOMAIN = find_domain("pursuit").on_map(WALL)
ROBOT = DOMAIN.robot()
DRIVES = route_drives(ROBOT, 60, seed=1).assign(action="pursue")
BESIDE_NAV2 = ("", "abort", "", "cancel", "", "")
Planned = list[tuple[Pose, Pose]]


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """Return a folder with a map, and a model that was learned on it."""
    save_map(WALL, tmp_path)
    model = train("pursue", DRIVES, ROBOT, features=DOMAIN.candidates("pursue"))
    model.metadata["training"] = {"map": str(WALL)}
    save_model(tmp_path / "pursue.json", model)
    return tmp_path


@pytest.fixture
def serve(client: Client, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Planned]]:
    """Yield a function that starts a planner: around the wall, for the first `finds` pairs.

    It interrupts requests while `interruptions` has items: "abort", as when another client sends
    one, or "cancel", as when another client cancels all.
    """
    provide_nav2_msgs(monkeypatch)
    kind = importlib.import_module("nav2_msgs.action").ComputePathToPose
    servers: list[Any] = []
    canceling = client.node.create_client(CancelGoal, "compute_path_to_pose/_action/cancel_goal")

    def start(
        *, finds: float = math.inf, accepts: bool = True, interruptions: Iterable[str] = ()
    ) -> Planned:
        planned: Planned = []
        interrupting = iter(interruptions)

        async def plan(handle: ServerGoalHandle) -> Any:
            interruption = next(interrupting, "")
            if interruption == "cancel":
                await canceling.call_async(CancelGoal.Request())
                handle.canceled()
                return kind.Result()
            if interruption == "abort":
                handle.abort()
                return kind.Result()
            start, goal = (
                pose_from(it.pose, "pose") for it in (handle.request.start, handle.request.goal)
            )
            assert handle.request.use_start
            assert handle.request.goal.header.frame_id == "map"
            planned.append((start, goal))
            answer = kind.Result()
            if len(planned) > finds:
                answer.error_code = kind.Result.NO_VALID_PATH
                handle.abort()
                return answer
            bend = () if start.x * goal.x > 0.0 else ((0.0, 3.0),)
            for x, y in (start[:2], *bend, goal[:2]):
                answer.path.poses.append(PoseStamped(pose=pose_of(Pose(x, y, 0.0))))
            handle.succeed()
            return answer

        response = GoalResponse.ACCEPT if accepts else GoalResponse.REJECT
        while servers:
            servers.pop().destroy()
        servers.append(
            ActionServer(
                client.node,
                kind,
                "compute_path_to_pose",
                plan,
                goal_callback=lambda _: response,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
        )
        return planned

    yield start
    for server in servers:
        server.destroy()


def request() -> RefineSubgoal.Request:
    sent = RefineSubgoal.Request()
    sent.situation.robot = pose_of(Pose(-3.0, 0.0, 0.0))
    middle = call("visit", Pose(3.0, 0.0, 0.0), opened=("yaw",))
    sent.chain.calls = [middle, call("visit", Pose(3.0, 3.0, math.pi / 2))]
    return sent


def test_refinement_asks_it_once_for_each_pair_of_places_and_recovers_when_it_does(
    host: Host, client: Client, models: Path, serve: Callable[..., Planned]
) -> None:
    parameters = {"domain": "pursuit", "models": models, "map": models / "map.yaml", "frame": "map"}
    node = host("refinement", planner="compute_path_to_pose", deadline=20.0, **parameters)
    assert f"models were learned on the map {WALL}, but are used on" in node.output
    assert "planner: expected the action server /compute_path_to_pose, got none" in (
        refine(client, request()).reason
    )
    serve(accepts=False)
    assert "/compute_path_to_pose rejected the goal" in refine(client, request()).reason
    serve(interruptions=itertools.repeat("abort"))
    assert "aborted all requests for 1 s (error code 0); if another client uses it" in (
        refine(client, request()).reason
    )
    serve(finds=0)
    without_path = (
        "calls[0].goal (visit): expected a place in reach of x -3.00 m, y 0.00 m, on the map"
    )
    assert without_path in refine(client, request()).reason
    nothing_open = request()
    nothing_open.chain.calls[0].open = []
    assert without_path in refine(client, nothing_open).reason
    planned = serve(interruptions=("abort", "cancel"))
    for _ in range(2):
        answer = refine(client, request())
        assert answer.accepted, answer.reason
    assert "paths of /compute_path_to_pose)" in answer.reason
    places = np.array([(start[:2], goal[:2]) for start, goal in planned])
    assert places == pytest.approx(np.array([[(-3, 0), (3, 0)], [(3, 0), (3, 3)]]), abs=0.05)


def test_the_thread_of_a_learned_set_does_not_ask_it(
    host: Host,
    models: Path,
    client: Client,
    serve: Callable[..., Planned],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    serve()
    warmed: list[bool] = []
    monkeypatch.setattr(
        "ator_ros.nodes.refinement.warm_up_refinement",
        lambda *_: warmed.append(current_thread() is main_thread()),
    )
    learned = models / "learned"
    node = host(
        "refinement", planner="compute_path_to_pose", domain="pursuit", frame="map",
        models=models, map=models / "map.yaml", learned=learned,
    )  # fmt: skip
    made = new_set_folder(learned)
    (made / "pursue.json").write_bytes((models / "pursue.json").read_bytes())
    seal(made, Manifest("", "2026-01-01T00:00:00Z", {}, {}, {}))
    publish(learned, made)
    client.eventually(lambda: "switched to the learned set" in node.output, "the learned set")
    assert warmed
    assert all(warmed)


@pytest.mark.parametrize(
    ("namespace", "name", "is_in_file"),
    [
        pytest.param("/robot1", "compute_path_to_pose", False, marks=pytest.mark.long),
        pytest.param("/robot2", "/robot2/compute_path_to_pose", False, marks=pytest.mark.long),
        ("/robot3", "compute_path_to_pose", True),
        pytest.param("/robot4", "/robot4/compute_path_to_pose", True, marks=pytest.mark.long),
    ],
)
def test_names_of_a_planner_are_alike_in_files_parameters_and_namespaces(
    host: Host,
    client: Client,
    models: Path,
    monkeypatch: pytest.MonkeyPatch,
    namespace: str,
    name: str,
    is_in_file: bool,
) -> None:
    provide_nav2_msgs(monkeypatch)
    given = {"domain": "pursuit", "models": str(models), "map": str(models / "map.yaml")}
    given |= {"frame": "map", "planner": name}
    words, parameters = ("-r", f"__ns:={namespace}"), given
    if is_in_file:
        file = models / "parameters.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}), encoding="utf-8")
        words, parameters = (*words, "--params-file", str(file)), {}
    host("refinement", *words, **parameters)
    answer = client.call(RefineSubgoal, f"{namespace}/refine_subgoal", request())
    expected = f"expected the action server {namespace}/compute_path_to_pose, got none"
    assert expected in answer.reason


def test_a_name_that_is_none_is_rejected(
    host: Host, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide_nav2_msgs(monkeypatch)
    with pytest.raises(
        SetupError, match="parameter planner: expected the name of an action, got 'a b'"
    ):
        host("refinement", map=models / "map.yaml", planner="a b")


@pytest.mark.long
def test_models_are_learned_from_its_paths(
    client: Client, models: Path, serve: Callable[..., Planned], domain: int
) -> None:
    planned = serve(interruptions=2 * BESIDE_NAV2)
    experience = models / "drives.parquet"
    write_experience(
        experience, Experience(DRIVES, {"robot_digest": ROBOT.digest(), "domain": "pursuit"})
    )
    words = [
        experience,
        "--domain",
        "pursuit",
        "--map",
        models / "map.yaml",
        "--models",
        models / "new",
    ]
    command = Process(
        "train", models / "log", domain, [*map(str, words), "--planner", "/compute_path_to_pose"]
    )
    client.eventually(lambda: not command.running, "the end of train", LONG_START)
    assert command.wait() == 0, command.output
    assert len(planned) == DRIVES["episode"].nunique()
    assert "left out" not in command.output
    model = load_model(models / "new" / "pursue.json", ROBOT, DOMAIN.known_features)
    assert "paths of /compute_path_to_pose" in model.metadata["training"]["map"]
    assert "route_length" in model.used_features
