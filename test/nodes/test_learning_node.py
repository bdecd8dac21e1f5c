"""The `learning` node: it stores records, and publishes better model sets."""

import json
import math
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Host, Start
from experience_rows import synthetic_model
from refinement_requests import refine, request_of_the_paper, save_small_models
from ros_client import Client, values_of
from std_srvs.srv import SetBool, Trigger
from stored import ROBOT, episodes, round_of, stored

from ator_interfaces.msg import ActionPerformance, ObjectState, Outcome
from ator_ros.experience.store import action_sets_in, read_records
from ator_ros.experience.table import Episode
from ator_ros.files import exclusive_folder
from ator_ros.learning.sets import RECORDS, current_set, digest_of, point_to, read_manifest
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import RESULTS
from ator_ros.performance.model_file import save_model


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """Return a folder with a model of the usual durations of synthetic episodes."""
    folder = tmp_path / "models"
    save_model(folder / "goToPose.json", synthetic_model("goToPose", ROBOT))
    return folder


def record_of(episode: Episode, code: int = Outcome.SUCCEEDED) -> ActionPerformance:
    message = ActionPerformance(action=episode.situation.action, action_set="default")
    message.start.robot = pose_of(episode.situation.robot.pose)
    message.start.objects = [ObjectState(name=name) for name in episode.situation.objects]
    message.call.top = "goToBall"
    message.call.goal.pose = pose_of(episode.situation.goal.pose)
    message.actual.duration = episode.duration
    message.actual.accuracy = 0.01
    message.heading_error = 0.02
    message.outcome.code = code
    return message


@pytest.fixture
def publish_records(client: Client) -> Callable[..., None]:
    """Return a function that publishes records, once the node subscribes."""
    publisher = client.node.create_publisher(ActionPerformance, "performance/action", RESULTS)

    def publish(*records: ActionPerformance) -> None:
        client.eventually(publisher.get_subscription_count, "a subscription to records")
        for record in records:
            publisher.publish(record)

    return publish


def stored_in(folder: Path) -> int:
    return len(read_records(folder / RECORDS, "default"))


def test_impossible_records_and_aborted_actions_are_omitted(
    host: Host, client: Client, publish_records: Callable[..., None], tmp_path: Path
) -> None:
    folder = tmp_path / "learned"
    node = host("learning", learned=folder)
    impossible = [record_of(episode) for episode in episodes(5)]
    impossible[0].actual.duration = math.nan
    impossible[1].action = "../../elsewhere"
    impossible[2].action = "shoot"  # which is not the action of goToBall
    impossible[3].start.robot.position.x = -900.0
    impossible[4].start.objects[0].name = "b" * 1_000_000
    (usual,) = episodes(1, seed=2)
    publish_records(*impossible, record_of(usual, Outcome.CANCELED), record_of(usual))
    client.eventually(lambda: stored_in(folder) == 1, "a record")
    values = values_of(client.status_of("learning"))
    assert (values["records taken"], values["records left out"]) == ("1", "5")
    assert "record left out: expected finite numbers" in node.output
    assert action_sets_in(folder / RECORDS) == ["default"]


def test_every_record_is_stored_or_counted(
    start: Start, client: Client, publish_records: Callable[..., None], tmp_path: Path
) -> None:
    """The node is stopped while more records come than queues hold."""
    folder = tmp_path / "learned"
    node = start("learning", learned=folder, batch=10_000)
    first, impossible = (record_of(episode) for episode in episodes(2))
    impossible.actual.duration = math.nan
    publish_records(first)
    client.eventually(lambda: stored_in(folder) == 1, "the first record")
    node.send(signal.SIGSTOP)
    publish_records(*[impossible] * 3000)
    node.send(signal.SIGCONT)
    publish_records(first)
    client.eventually(lambda: stored_in(folder) == 2, "the last record")
    values = values_of(client.status_of("learning"))
    counts = [int(values[f"records {name}"]) for name in ("stored", "left out", "lost")]
    assert sum(counts) == 3002
    assert counts[2] > 1000


def test_learning_can_be_frozen(
    host: Host, client: Client, publish_records: Callable[..., None], tmp_path: Path, models: Path
) -> None:
    folder = tmp_path / "learned"
    host("learning", learned=folder, models=models, batch=1000)
    assert client.call(SetBool, "learning/freeze", SetBool.Request(data=True)).success
    publish_records(*map(record_of, episodes(45, slower=1.3)))
    client.eventually(lambda: stored_in(folder) == 45, "records")
    refused = client.call(Trigger, "learning/learn_now", Trigger.Request())
    assert (refused.success, refused.message) == (False, "learning is frozen")
    assert values_of(client.status_of("learning"))["frozen"] == "True"
    with (
        pytest.raises(OSError, match="expected a folder that no other process uses"),
        exclusive_folder(folder),
    ):
        pass
    assert current_set(folder) is None
    assert client.call(SetBool, "learning/freeze", SetBool.Request(data=False)).success
    assert values_of(client.status_of("learning"))["frozen"] == "False"


@pytest.mark.long
def test_a_round_of_learning_can_be_requested(
    host: Host, client: Client, publish_records: Callable[..., None], tmp_path: Path, models: Path
) -> None:
    folder = tmp_path / "learned"
    node = host("learning", learned=folder, models=models, batch=1000)
    publish_records(*map(record_of, episodes(45, slower=1.3)))
    client.eventually(lambda: stored_in(folder) == 45, "records")
    assert client.call(Trigger, "learning/learn_now", Trigger.Request()).success
    # rounds have a low priority
    place = client.eventually(lambda: current_set(folder), "a set", patience=240.0)
    client.eventually(lambda: "default/goToPose: " in node.output, "the verdict in the log")
    manifest, values = read_manifest(place), values_of(client.status_of("learning"))
    assert (values["set"], values["last switch"]) == (manifest.digest, manifest.time)
    assert values["default/goToPose: switched"] == manifest.reasons["default/goToPose"]
    assert "error from" in values["default/goToPose: switched"]


@pytest.mark.long
def test_it_continues_after_a_kill(
    start: Start, client: Client, publish_records: Callable[..., None], tmp_path: Path, models: Path
) -> None:
    folder, records = tmp_path / "learned", list(map(record_of, episodes(45, slower=1.3)))
    first = start("learning", learned=folder, models=models, batch=40)
    publish_records(*records[:30])
    client.eventually(lambda: (folder / RECORDS).exists() and stored_in(folder) == 30, "records")
    first.kill()
    second = start("learning", learned=folder, models=models, batch=40)
    client.eventually(lambda: "30 records" in second.output, "the second node")
    assert values_of(client.status_of("learning"))["records since the last round"] == "30"
    publish_records(*records[30:])
    client.eventually(lambda: stored_in(folder) == 45, "the other records")
    # rounds have a low priority
    client.eventually(lambda: current_set(folder), "a set", patience=240.0)


@pytest.fixture(scope="module")
def slower(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a folder of small models, and a set learned from drives that took twice as long."""
    models, folder = (tmp_path_factory.mktemp(name) for name in ("models", "learned"))
    save_small_models(models)
    stored(folder / RECORDS, episodes(60, slower=2.0)).close()
    round_of(folder, models)
    return models, current_set(folder)


def published(place: Path, folder: Path) -> Path:
    copy = folder / "sets" / place.name
    shutil.copytree(place, copy)
    point_to(folder, copy)
    return copy


@pytest.mark.long
def test_the_executor_loads_a_set(
    host: Host, client: Client, tmp_path: Path, slower: tuple[Path, Path]
) -> None:
    models, learned = slower
    node = host("executor", models=models, learned=tmp_path)
    digest = digest_of(published(learned, tmp_path))
    client.eventually(lambda: f"switched to the learned set {digest}" in node.output, "the switch")


def test_the_refinement_node_loads_a_set(
    host: Host, client: Client, tmp_path: Path, slower: tuple[Path, Path]
) -> None:
    models, learned = slower
    node = host("refinement", models=models, learned=tmp_path, gate=False)
    before = refine(client, request_of_the_paper())
    place = published(learned, tmp_path)
    digest = digest_of(place)
    client.eventually(lambda: f"switched to the learned set {digest}" in node.output, "the switch")
    after = refine(client, request_of_the_paper())
    first, last = (answer.before_actions[0].duration for answer in (before, after))
    assert last == pytest.approx(2.0 * first, rel=0.25)
    assert after.before_actions[1].duration == before.before_actions[1].duration
    values = values_of(client.status_of("refinement"))
    expected = f"{digest} of 2026-01-01T00:00:00Z from episodes: 60 of default/goToPose"
    assert values["learned set"] == expected
    # An incomplete set is not loaded.
    broken = tmp_path / "sets" / "000009-broken"
    shutil.copytree(place, broken)
    (broken / "goToPose.json").write_text(json.dumps({}))
    point_to(tmp_path, broken)
    client.eventually(lambda: "000009-broken is not used: " in node.output, "a warning")
    assert refine(client, request_of_the_paper()).before.duration == after.before.duration


def test_some_executed_chains_run_unrefined_to_compare(
    host: Host, client: Client, tmp_path: Path, slower: tuple[Path, Path]
) -> None:
    host("refinement", models=slower[0], learned=tmp_path / "learned", deadline=20.0)
    request = request_of_the_paper(yaw=3.0)
    request.measure = True
    answers = (refine(client, request) for _ in range(200))  # a tenth of them compares
    compared = next(answer for answer in answers if answer.gain.comparison)
    assert not compared.refined
    assert "kept as sent, to measure what refinement gains" in compared.reason
    assert compared.chain.calls[0].goal.pose.orientation.z == pytest.approx(math.sin(1.5))
    assert compared.gain.predicted > 0.5
    assert client.set_parameters("refinement", comparison_share=0.0)[0].successful
    assert all(refine(client, request).refined for _ in range(50))
