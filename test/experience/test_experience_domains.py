"""Experience of other domains: columns of their objects, records of their actions."""

from pathlib import Path
from typing import Any

import pytest
from bags import action_performance, own_types, write_records
from experience_rows import synthetic_experience
from outside.delivery import DELIVERY

from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.drives import top_between
from ator_ros.experience.recordings import read_recording, read_sources
from ator_ros.experience.table import (
    Experience,
    ExperienceError,
    objects_of_columns,
    write_experience,
)
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_model
from ator_ros.tools import train

ROBOT = load_robot()


def test_a_table_of_another_domain_is_rejected(tmp_path: Path) -> None:
    file = tmp_path / "table.parquet"
    write_experience(file, Experience(synthetic_experience("goToPose"), {"domain": "soccer"}))
    with pytest.raises(
        ExperienceError, match=r"metadata\.domain: expected 'delivery', got .soccer."
    ):
        read_sources([file], ROBOT, DELIVERY)


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
    experience = read_recording(tmp_path / "bag", ROBOT, DELIVERY)
    assert experience.metadata["domain"] == "delivery"
    assert objects_of_columns(experience.frame) == ("parcel", "station", "box")
    rows = experience.of("dock")
    assert set(rows["hold"]) == {0}
    assert rows[["station_x", "station_y", "box_x", "box_y"]].iloc[3].tolist() == [
        2.0,
        0.5,
        0.5,
        1.0,
    ]
    assert rows["parcel_x"].isna().all()
    assert train.main([str(tmp_path / "bag"), "--models", str(tmp_path / "models")]) == 0
    model = load_model(tmp_path / "models" / "dock.json", ROBOT, DELIVERY.known_features)
    assert model.action == "dock"
    assert model.trees["duration"].samples[0] == 25


def test_records_with_unknown_object_names_are_omitted(tmp_path: Path) -> None:
    store = own_types()
    records = [dock(store, 0), dock(store, 1, **{"../evil": (0.0, 0.0)})]
    records.append(dock(store, 2, **{f"o{number}": (0.0, 0.0) for number in range(17)}))
    write_records(tmp_path / "bag", store, records)
    (remark,) = read_recording(tmp_path / "bag", ROBOT, DELIVERY).remarks
    assert remark.startswith("bag: left out 2 of 3 records: ")
    many = [dock(store, number, **{f"o{number}": (0.0, 0.0)}) for number in range(17)]
    write_records(tmp_path / "many", store, many)
    with pytest.raises(ExperienceError, match=r"many: expected at most 16 objects .*, got 18"):
        read_recording(tmp_path / "many", ROBOT, DELIVERY)


def test_held_objects_determine_the_top() -> None:
    tops = [
        top_between(SOCCER.tops, *held) for held in ((None, None), (None, "ball"), ("ball", "ball"))
    ]
    assert [top.name if top else "" for top in tops] == ["goToPose", "goToBall", "dribbleBall"]
    # A ball lost during the drive leaves a plain drive.
    lost = top_between(SOCCER.tops, "ball", None)
    assert lost.name == "goToPose"
    assert top_between(SOCCER.tops[-1:], None, None) is None
