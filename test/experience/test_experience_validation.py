"""Untrusted tables and recordings: names with paths, invalid values."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bags import action_performance, own_types, write_records
from experience_rows import synthetic_experience

from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.table import Experience, ExperienceError, read_experience, write_experience
from ator_ros.files import FileError
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_models, save_model
from ator_ros.performance.training import train
from ator_ros.tools.train import main

ROBOT = load_robot()
ELSEWHERE = ["../evil", "a b"]


def table(folder: Path, frame: pd.DataFrame, action_set: object = "default") -> Path:
    file = folder / "table.parquet"
    write_experience(
        file, Experience(frame, {"robot_digest": ROBOT.digest(), "action_set": action_set})
    )
    return file


def files_below(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", ELSEWHERE)
@pytest.mark.parametrize("field", ["action", "action_set"])
def test_names_in_a_table_cannot_change_the_output_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, field: str
) -> None:
    frame = synthetic_experience("goToPose" if field == "action_set" else name, episodes=40)
    file = table(tmp_path, frame, name if field == "action_set" else "default")
    assert main([str(file), "--models", str(tmp_path / "deep" / "models")]) == 1
    assert f"table.parquet: {field}: expected a name" in capsys.readouterr().err
    assert files_below(tmp_path) == {file}


def test_a_column_must_not_occur_twice(tmp_path: Path) -> None:
    file = table(tmp_path, synthetic_experience("goToPose", episodes=2))
    whole = pq.read_table(file)
    twice = pa.Table.from_arrays([*whole.columns, whole["x"]], [*whole.column_names, "x"])
    pq.write_table(twice.replace_schema_metadata(whole.schema.metadata), file)
    with pytest.raises(ExperienceError, match="expected each column once"):
        read_experience(file)


def test_rows_are_counted_before_they_are_read(tmp_path: Path) -> None:
    file = table(tmp_path, synthetic_experience("goToPose", episodes=2))
    schema = pq.read_schema(file)
    row = {item.name: pa.array([None], item.type) for item in schema}
    many = [pa.repeat(row[name][0], 100_000) for name in schema.names]
    with pq.ParquetWriter(file, schema) as writer:
        for _ in range(25):
            writer.write_table(pa.Table.from_arrays(many, schema=schema))
    assert file.stat().st_size < 1_000_000
    with pytest.raises(ExperienceError, match="expected at most 2,000,000 rows, got 2,500,000"):
        read_experience(file)


@pytest.mark.parametrize("seed", ["abc", -1, 1.5, [1], True, "x" * 10_000])
def test_a_seed_that_is_no_whole_number_is_rejected(tmp_path: Path, seed: object) -> None:
    file = tmp_path / "table.parquet"
    write_experience(file, Experience(synthetic_experience("goToPose", episodes=2), {"seed": seed}))
    with pytest.raises(ExperienceError, match=r"metadata\.seed: expected a whole number"):
        read_experience(file)


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("t", [np.nan, -0.1]),
        ("duration", [np.nan, -1.0, 2e9, "2"]),
        ("time_to_go", [-0.1, np.nan]),
        ("x", [np.inf, -2e9, 2e9, [1.0]]),
        ("speedg", [-0.1]),
        ("vy", [np.nan]),
        ("ball_x", [1e308, "near"]),
        ("hold", [2, -1, 0.5, "yes"]),
        ("episode", [-1, 0.5, 2e9]),
        ("success", [2, -1]),
        ("position_error", [-0.1, np.inf]),
        ("heading_error", [-0.1]),
        ("nearer", [-0.1]),
        ("driven", [2e9]),
        ("action", [None, "a b"]),
    ],
)
def test_invalid_values_of_a_column_are_rejected(
    tmp_path: Path, column: str, values: list[object]
) -> None:
    whole = synthetic_experience("goToPose", episodes=5)
    for value in values:
        with pytest.raises(ExperienceError, match=rf"table\.parquet: {column}: expected "):
            read_experience(table(tmp_path, whole.assign(**{column: [value] * 5})))


@pytest.mark.parametrize(
    ("column", "value"),
    [("ball_x", np.nan), ("position_error", np.nan), ("heading_error", np.nan), ("driven", -1e9),
     ("first_turn", np.nan), ("x", -1e9), ("duration", 1e9), ("hold", 1), ("t", 0)],
)  # fmt: skip
def test_values_within_the_range_of_a_column_are_read(
    tmp_path: Path, column: str, value: float
) -> None:
    whole = synthetic_experience("goToPose", episodes=5).assign(**{column: [value] * 5})
    read = read_experience(table(tmp_path, whole)).frame
    assert np.array_equal(read[column].to_numpy(dtype=float), [value] * 5, equal_nan=True)


def test_a_table_has_a_bounded_number_of_objects_and_goal_variables(tmp_path: Path) -> None:
    whole = synthetic_experience("goToPose", episodes=5)
    objects = {f"o{number}_{axis}": [0.0] * 5 for number in range(15) for axis in "xy"}
    declared = {f"variable{number}g": [0.0] * 5 for number in range(8)}
    read = read_experience(table(tmp_path, whole.assign(**objects, **declared)))
    assert {*objects, *declared} <= {*read.frame.columns}
    for more in ({"p_x": [0.0] * 5, "p_y": [0.0] * 5}, {"oneg": [0.0] * 5}):
        with pytest.raises(ExperienceError, match="expected at most 16 objects and 8 goal"):
            read_experience(table(tmp_path, whole.assign(**objects, **declared, **more)))


def test_a_table_without_rows_is_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = table(tmp_path, synthetic_experience("goToPose", episodes=5).iloc[:0])
    assert main([str(file), "--models", str(tmp_path)]) == 1
    assert "table.parquet: expected rows of experience, found none" in capsys.readouterr().err


def test_models_in_the_wrong_place_are_rejected(tmp_path: Path) -> None:
    model = train("goToPose", synthetic_experience("goToPose"), ROBOT)
    save_model(tmp_path / "dribbleBall.json", model)
    with pytest.raises(
        FileError, match=r"dribbleBall\.json: action: expected 'dribbleBall' in this place"
    ):
        load_models(ROBOT, SOCCER.known_features, folder=tmp_path)
    save_model(tmp_path / "bezier" / "goToPose.json", model)
    with pytest.raises(
        FileError, match=r"goToPose\.json: action_set: expected 'bezier' in this place"
    ):
        load_models(ROBOT, SOCCER.known_features, action_set="bezier", folder=tmp_path)


def test_records_name_their_action_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = own_types()
    sets = ["bezier", "bezier", "default"]
    records = [
        action_performance(
            store, goal=Pose(1.5, 0.5, 0.7), speed=0.0, duration=3.0, code=1, action_set=name
        )
        for name in sets
    ]
    write_records(tmp_path / "one", store, records[:2])
    assert main([str(tmp_path / "one"), "--action-set", "default", "--models", str(tmp_path)]) == 1
    assert "expected experience of one action set, got bezier, default" in capsys.readouterr().err
    write_records(tmp_path / "both", store, records)
    assert main([str(tmp_path / "both"), "--models", str(tmp_path)]) == 1
    assert (
        "both: expected records of one action set, got bezier, default" in capsys.readouterr().err
    )
