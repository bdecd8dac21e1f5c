"""Experience of other domains: columns of their objects, records of their actions."""

import dataclasses
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import action_performance, own_types, write_records
from experience_rows import synthetic_experience
from parcels import CARRY, PARCELS

from ator_ros.domains import domain as domains
from ator_ros.domains.domain import Domain
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.drives import top_between
from ator_ros.experience.recordings import read_recording, read_sources
from ator_ros.experience.table import (
    Experience,
    ExperienceError,
    columns,
    object_columns,
    objects_of_columns,
    read_experience,
    write_experience,
)
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_model
from ator_ros.robot.description import load_robot
from ator_ros.tools import collect, train

ROBOT = load_robot()
BARE = dataclasses.replace(
    PARCELS, name="bare", objects=(), bodies={}, tops=(dataclasses.replace(CARRY, pre=type(CARRY.pre)()),)
)


@pytest.fixture(params=[PARCELS, BARE], ids=lambda domain: domain.name)
def installed(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Domain:
    domain: Domain = request.param
    value = f"test_experience_domains:{'BARE' if domain is BARE else 'PARCELS'}"
    entries = [EntryPoint(domain.name, value, domains.GROUP)]
    monkeypatch.setattr(domains, "entry_points", lambda **_: entries)
    return domain


def test_a_domain_of_any_objects_is_collected_and_learned(installed: Domain, tmp_path: Path) -> None:
    table = tmp_path / "table.parquet"
    words = ["--domain", installed.name, "--episodes", "22", "--seed", "3", "--jobs", "1"]
    assert collect.main([*words, "--out", str(table)]) == 0
    experience = read_experience(table)
    assert experience.metadata["domain"] == installed.name
    assert objects_of_columns(experience.frame) == installed.objects
    assert list(experience.frame.columns) == list(columns(installed.objects))
    assert not [name for name in experience.frame.columns if name.startswith("ball")]
    places = experience.frame[object_columns(installed.objects)]
    assert np.isfinite(places.to_numpy()).all()
    assert train.main(["--domain", installed.name, str(table), "--models", str(tmp_path / "models")]) == 0
    assert (
        load_model(tmp_path / "models" / "carry.json", installed.robot(), installed.known_features).action
        == "carry"
    )


def test_a_table_of_another_domain_is_rejected(tmp_path: Path) -> None:
    file = tmp_path / "table.parquet"
    write_experience(file, Experience(synthetic_experience("goToPose"), {"domain": "soccer"}))
    with pytest.raises(ExperienceError, match=r"metadata\.domain: expected 'parcels', got .soccer."):
        read_sources([file], ROBOT, PARCELS)


def dock(store: Any, number: int, **objects: tuple[float, float]) -> Any:
    """Return the record of an action that no shipped domain has."""
    goal = Pose(1.0 + 0.05 * number, 0.0, 0.0)
    message = action_performance(
        store, goal=goal, speed=0.0, duration=2.0 + 0.1 * number, code=1, action="dock"
    )
    message.call.top = "dockAt"
    (first,) = message.start.objects
    message.start.objects = [
        type(first)(name=name, position=type(first.position)(x, y, 0.0), velocity=first.velocity)
        for name, (x, y) in objects.items()
    ]
    return message


def test_records_of_any_action_are_learned(tmp_path: Path) -> None:
    store = own_types()
    records = [dock(store, number, station=(2.0, 0.5), box=(0.5, 1.0)) for number in range(25)]
    write_records(tmp_path / "bag", store, records)
    experience = read_recording(tmp_path / "bag", ROBOT, PARCELS)
    assert experience.metadata["domain"] == "parcels"
    assert objects_of_columns(experience.frame) == ("box", "cart", "station")
    rows = experience.of("dock")
    assert set(rows["hold"]) == {0}
    assert rows[["station_x", "station_y", "box_x", "box_y"]].iloc[3].tolist() == [2.0, 0.5, 0.5, 1.0]
    assert rows["cart_x"].isna().all()
    assert train.main([str(tmp_path / "bag"), "--models", str(tmp_path / "models")]) == 0
    model = load_model(tmp_path / "models" / "dock.json", ROBOT, PARCELS.known_features)
    assert model.action == "dock"
    assert model.trees["duration"].samples[0] == 25


def test_records_with_unknown_object_names_are_omitted(tmp_path: Path) -> None:
    store = own_types()
    records = [dock(store, 0), dock(store, 1, **{"../evil": (0.0, 0.0)})]
    records.append(dock(store, 2, **{f"o{number}": (0.0, 0.0) for number in range(17)}))
    write_records(tmp_path / "bag", store, records)
    (remark,) = read_recording(tmp_path / "bag", ROBOT, PARCELS).remarks
    assert remark.startswith("bag: left out 2 of 3 records: ")
    many = [dock(store, number, **{f"o{number}": (0.0, 0.0)}) for number in range(17)]
    write_records(tmp_path / "many", store, many)
    with pytest.raises(ExperienceError, match=r"many: expected at most 16 objects .*, got 19"):
        read_recording(tmp_path / "many", ROBOT, PARCELS)


def test_held_objects_determine_the_top() -> None:
    tops = [top_between(SOCCER.tops, *held) for held in ((None, None), (None, "ball"), ("ball", "ball"))]
    assert [top.name if top else "" for top in tops] == ["goToPose", "goToBall", "dribbleBall"]
    # A ball lost during the drive leaves a plain drive.
    lost = top_between(SOCCER.tops, "ball", None)
    assert lost.name == "goToPose"
    assert top_between(SOCCER.tops[-1:], None, None) is None
