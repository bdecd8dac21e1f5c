"""Damaged or excessive files are read, or rejected with an error of this package."""

import contextlib
import json
import math
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from bags import recorded
from experience_rows import synthetic_experience
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ator_ros.bases.description import ConfigError, load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.recordings import read_recording
from ator_ros.experience.table import Experience, ExperienceError, read_experience, write_experience
from ator_ros.files import FileError
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.training import train
from ator_ros.resources import resource_path

ROBOT = load_robot()
LOADERS: dict[str, tuple[Callable[[Path], Any], type[Exception]]] = {
    "pioneer.yaml": (load_robot, ConfigError),
    "model.json": (lambda file: load_model(file, ROBOT, SOCCER.known_features), FileError),
    "table.parquet": (read_experience, ExperienceError),
    "drive.mcap": (lambda file: read_recording(file, ROBOT, SOCCER), ExperienceError),
}
STRUCTURED: dict[str, tuple[Callable[[str], Any], Callable[[Any], str]]] = {
    "pioneer.yaml": (yaml.safe_load, yaml.safe_dump),
    "model.json": (json.loads, json.dumps),
}
ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(
        [math.nan, math.inf, 0, -1, "", "../../etc/passwd", "!!python/object:os.system"]
    ),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
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
    """Return a folder with a valid file of each kind."""
    folder = tmp_path_factory.mktemp("whole")
    shutil.copy(resource_path("config", "pioneer.yaml"), folder)
    rows = synthetic_experience("goToPose")
    save_model(folder / "model.json", train("goToPose", rows, ROBOT))
    write_experience(folder / "table.parquet", Experience(rows, {"robot_digest": ROBOT.digest()}))
    recorded(folder)
    shutil.copy(next((folder / "bag").glob("*.mcap")), folder / "drive.mcap")
    return folder


def read_or_refuse(file: Path, name: str) -> None:
    """Read a file; only the error of its kind may be raised, in one line with the file name."""
    load, error = LOADERS[name]
    refusal = name
    try:
        load(file)
    except error as raised:
        refusal = str(raised)
    assert name in refusal


@contextlib.contextmanager
def copy_of(name: str, content: bytes) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, name)
        file.write_bytes(content)
        yield file


@pytest.mark.parametrize("name", LOADERS)
def test_the_files_are_valid_before_they_are_damaged(whole: Path, name: str) -> None:
    LOADERS[name][0](whole / name)


@pytest.mark.parametrize("name", LOADERS)
@PATIENT
@given(data=st.data())
def test_damaged_bytes_are_rejected(whole: Path, name: str, data: st.DataObject) -> None:
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
def test_other_values_are_rejected(whole: Path, name: str, data: st.DataObject) -> None:
    parse, write = STRUCTURED[name]
    tree = parse((whole / name).read_text(encoding="utf-8"))
    replace_one(tree, data)
    with copy_of(name, write(tree).encode()) as file:
        read_or_refuse(file, name)


def replace_one(tree: Any, data: st.DataObject) -> None:
    """Replace or remove one value in a tree of lists and dictionaries."""
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


def test_files_larger_than_20_mb_are_rejected(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_bytes(b" " * 20_000_001)
    load, error = LOADERS["model.json"]
    with pytest.raises(error, match=r"model\.json: .*expected at most 20 MB, got more"):
        load(tmp_path / "model.json")


PIONEER = resource_path("config", "pioneer.yaml").read_text(encoding="utf-8")


def alias_bomb() -> str:
    """Return a YAML text that expands to 10^9 values with nine lines of aliases."""
    lines = ['a0: &a0 ["ha", "ha"]']
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    return "\n".join([*lines, "robot: *a9", ""])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (alias_bomb(), "line 2: expected no alias, got *a0"),
        (
            '"a\\e[31mX": 1\n"a\\e[31mX": 2\n',
            "line 2: expected each key once, got a\\x1b[31mX again",
        ),
        ("# " + "x" * 200_000, "expected at most 0.1 MB"),
        (
            PIONEER.replace("v: 1.2", "v: 1200", 1),
            "limits.v: expected a number from 0.01 to 20; got 1200",
        ),
        (
            PIONEER.replace("  track:", "  tracks:"),
            "[build, drive, grip, holder, stop]; missing track and unknown",
        ),
        (
            "format: ator_ros domain\n" + PIONEER,
            "format: expected 'ator_ros robot', got 'ator_ros domain'",
        ),
        (
            "format: ator_ros robot\nschema_version: 2\n" + PIONEER,
            "schema_version: expected 1, got 2",
        ),
    ],
)
def test_invalid_robots_are_rejected_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    assert text != PIONEER
    file = tmp_path / "robot.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as refusal:
        load_robot(file)
    assert message in str(refusal.value)
    assert len(str(refusal.value)) < 1000
    assert len(str(refusal.value).splitlines()) <= 4  # a YAML error shows where
