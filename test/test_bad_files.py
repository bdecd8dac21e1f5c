"""Files that are damaged anywhere, in any way: they are read, or refused with an error of our own."""

from __future__ import annotations

import contextlib
import json
import math
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from experience_rows import made_up_experience
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.columns import ExperienceError
from ator_ros.experience.recordings import read_recording
from ator_ros.experience.table import read_experience
from ator_ros.performance.model_file import ModelFileError, load_model, save_model
from ator_ros.performance.training import train
from ator_ros.refinement import RefinementError
from ator_ros.refinement.calibration import load_calibration
from ator_ros.refinement.gate import load_gate
from ator_ros.resources import resource_path
from ator_ros.robot.description import ConfigError, load_robot

ROBOT = load_robot()
LOADERS: dict[str, tuple[Callable[[Path], Any], type[Exception]]] = {
    "pioneer.yaml": (load_robot, ConfigError),
    "model.json": (lambda file: load_model(file, ROBOT, SOCCER.known_features), ModelFileError),
    "gate.json": (load_gate, RefinementError),
    "calibration.json": (load_calibration, RefinementError),
    "table.parquet": (read_experience, ExperienceError),
    "drive.mcap": (lambda file: read_recording(file, ROBOT, SOCCER), ExperienceError),
}
STRUCTURED: dict[str, tuple[Callable[[str], Any], Callable[[Any], str]]] = {
    "pioneer.yaml": (yaml.safe_load, yaml.safe_dump),
    "model.json": (json.loads, json.dumps),
    "gate.json": (json.loads, json.dumps),
    "calibration.json": (json.loads, json.dumps),
}
ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from([math.nan, math.inf, 0, -1, "", "../../etc/passwd", "!!python/object:os.system"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
PATIENT = settings(
    deadline=None,
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with one good file of each kind."""
    from test_recordings import record

    from ator_ros.experience.table import Experience, write_experience

    folder = tmp_path_factory.mktemp("whole")
    shutil.copy(resource_path("config", "pioneer.yaml"), folder)
    shutil.copy(resource_path("models", "gate.json"), folder)
    shutil.copy(resource_path("models", "calibration.json"), folder)
    rows = made_up_experience("goToPose")
    save_model(folder / "model.json", train("goToPose", rows, ROBOT))
    write_experience(folder / "table.parquet", Experience(rows, {"robot_digest": ROBOT.digest()}))
    record(folder / "bag")
    shutil.copy(next((folder / "bag").glob("*.mcap")), folder / "drive.mcap")
    return folder


def read_or_refuse(file: Path, name: str) -> None:
    """Read a file; only the error of its kind may come out, in one line that names the file."""
    load, error = LOADERS[name]
    refusal = name
    try:
        load(file)
    except error as told:
        refusal = str(told)
    assert name in refusal


@contextlib.contextmanager
def copy_of(name: str, content: bytes) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, name)
        file.write_bytes(content)
        yield file


@pytest.mark.parametrize("name", LOADERS)
def test_the_files_are_good_before_they_are_damaged(whole: Path, name: str) -> None:
    LOADERS[name][0](whole / name)


@pytest.mark.parametrize("name", LOADERS)
@PATIENT
@given(data=st.data())
def test_damaged_bytes_are_refused(whole: Path, name: str, data: st.DataObject) -> None:
    content = bytearray((whole / name).read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    kind = data.draw(st.sampled_from(["truncated", "overwritten", "inserted"]))
    junk = data.draw(st.binary(min_size=1, max_size=8))
    if kind == "truncated":
        del content[place:]
    elif kind == "overwritten":
        content[place : place + len(junk)] = junk
    else:
        content[place:place] = junk
    with copy_of(name, bytes(content)) as file:
        read_or_refuse(file, name)


@pytest.mark.parametrize("name", STRUCTURED)
@PATIENT
@given(data=st.data())
def test_other_values_are_refused(whole: Path, name: str, data: st.DataObject) -> None:
    parse, write = STRUCTURED[name]
    tree = parse((whole / name).read_text(encoding="utf-8"))
    replace_one(tree, data)
    with copy_of(name, write(tree).encode()) as file:
        read_or_refuse(file, name)


def replace_one(tree: Any, data: st.DataObject) -> None:
    """Put anything in the place of one value of a tree of lists and dictionaries, or take it away."""
    while True:
        keys = list(tree) if isinstance(tree, dict) else list(range(len(tree)))
        key = data.draw(st.sampled_from(keys))
        child = tree[key]
        if isinstance(child, dict | list) and child and data.draw(st.booleans()):
            tree = child
            continue
        if data.draw(st.booleans()):
            tree[key] = data.draw(ANYTHING)
        else:
            del tree[key]
        return


@pytest.mark.parametrize("name", STRUCTURED)
@pytest.mark.parametrize(
    "oddity",
    [
        "9" * 400,
        "-" + "9" * 5000,
        "1e400",
        "2024-13-45",
        "!!int x",
        "!!timestamp x",
        "[" * 5000,
        "{? [1]: 2}",
    ],
)
def test_values_that_parsers_stumble_over_are_refused(
    whole: Path, tmp_path: Path, name: str, oddity: str
) -> None:
    places = {"pioneer.yaml": "mass: ", "model.json": '"schema_version": ', "gate.json": '"gain": '}
    places["calibration.json"] = '"constant": '
    before, found, after = (whole / name).read_text(encoding="utf-8").partition(places[name])
    assert found
    damaged = tmp_path / name
    damaged.write_text(
        before + found + oddity + after[re.match(r"[^,#\n]*", after).end() :], encoding="utf-8"
    )  # type: ignore[union-attr]
    load, error = LOADERS[name]
    with pytest.raises(error, match=name):
        load(damaged)


@pytest.mark.parametrize("name", LOADERS)
def test_paths_that_hold_no_such_file_are_refused(tmp_path: Path, name: str) -> None:
    load, error = LOADERS[name]
    (tmp_path / name).symlink_to(tmp_path / "nowhere")
    (tmp_path / "folder" / name).mkdir(parents=True)
    empty = tmp_path / "empty" / name
    empty.parent.mkdir()
    empty.touch()
    for file in (tmp_path / name, tmp_path / "folder" / name, empty, tmp_path / "missing" / name):
        with pytest.raises(error, match=name):
            load(file)
