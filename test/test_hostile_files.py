"""Small files that claim, or unpack to, more than any machine has: they are refused in time and in memory."""

from __future__ import annotations

import json
import os
import resource
import time
from pathlib import Path

import pandas as pd
import pytest
from experience_rows import made_up_experience

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.table import Experience, read_experience, write_experience
from ator_ros.files import read_json
from ator_ros.performance.model_file import ModelFileError, load_model
from ator_ros.refinement import RefinementError
from ator_ros.refinement.gate import load_gate
from ator_ros.resources import resource_path
from ator_ros.robot.description import ConfigError, load_robot
from ator_ros.tools import train

ROBOT = load_robot()
PIONEER = resource_path("config", "pioneer.yaml").read_text(encoding="utf-8")

HEAD = "format: ator_ros robot\nschema_version: 1\n"
SIZES = "{radius: 0.1, mass: 0.1, rolling_deceleration: 0.1, restitution: 0.1}"
OBJECTS = "".join(f"    o{number}: {SIZES}\n" for number in range(101))
BAY = "    - {x: 0.0, y: 0.0, yaw: 0.0, width: 1.0, depth: 1.0}\n"


def laughs() -> str:
    """Return a YAML text that names 10^9 values with nine lines of aliases."""
    lines = ['a0: &a0 ["ha", "ha"]']
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    return "\n".join([*lines, "robot: *a9", ""])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (laughs(), "line 2: expected no alias, got *a0"),
        ("robot:\n  v: 1\n  w: 2\n  v: 3\n", "line 4: expected each key once, got v again"),
        ('"a\\e[31mX": 1\n"a\\e[31mX": 2\n', "line 2: expected each key once, got a\\x1b[31mX again"),
        ("robot: &r {v: 1}\nball: *r\nfield: *r\n", "expected no alias"),
        ("# " + "x" * 200_000, "expected at most 0.1 MB"),
        ("robot: [" + "1," * 5_000 + "]\nball: 1\nfield: 1\n", "robot: expected a table with"),
        (
            PIONEER.replace("v: 1.2", "v: 1200", 1),
            "robot.limits.v: expected a number from 0.01 to 20; got 1200",
        ),
        (
            PIONEER.replace("    gap: 0.25\n", ""),
            "robot.holder: expected the fields gap, length, limits, radius, thickness; missing gap",
        ),
        (
            PIONEER.replace("    ball:", "    my ball:"),
            "scene.objects.my ball: expected a name of letters, digits and _; got 'my ball'",
        ),
        (
            PIONEER.replace("  track:", "  tracks:"),
            "[build, grip, holder, stop]; missing track and unknown tracks",
        ),
        (PIONEER.replace("robot:", "robots:", 1), "expected the fields robot, scene; missing robot"),
        ("format: ator_ros domain\n" + PIONEER, "format: expected 'ator_ros robot', got 'ator_ros domain'"),
        (HEAD.replace("1", "2") + PIONEER, "schema_version: expected 1, got 2"),
        ("schema_version: 1\n" + PIONEER, "format: expected 'ator_ros robot'"),
        (
            PIONEER.replace("  objects:\n", "  objects:\n" + OBJECTS),
            "scene.objects: expected at most 100 entries; got",
        ),
    ],
)
def test_robots_that_cannot_be_are_refused_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    assert text != PIONEER
    file = tmp_path / "robot.yaml"
    file.write_text(text, encoding="utf-8")
    began = time.process_time()
    with pytest.raises(ConfigError) as refusal:
        load_robot(file)
    assert time.process_time() - began < 2.0
    assert message in str(refusal.value)
    assert len(str(refusal.value)) < 1000
    assert len(str(refusal.value).splitlines()) <= 4  # a YAML error shows where


def test_a_description_may_state_its_format_and_version(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(HEAD + PIONEER, encoding="utf-8")
    assert load_robot(file) == ROBOT


def test_a_file_of_numbers_without_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "model.json").symlink_to("/dev/zero")
    refuses_both(tmp_path / "model.json")


def test_a_pipe_that_nobody_writes_to_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "model.json")
    refuses_both(tmp_path / "model.json")


def refuses_both(file: Path) -> None:
    with pytest.raises(ModelFileError, match="expected an ordinary file, got a folder, a pipe or a device"):
        load_model(file, ROBOT, SOCCER.known_features)
    with pytest.raises(RefinementError, match="expected an ordinary file"):
        load_gate(file)


def test_the_gate_of_other_actions_is_refused() -> None:
    gate = resource_path("models", "bezier", "gate.json")
    assert load_gate(gate, "bezier")
    with pytest.raises(RefinementError, match="action_set: expected 'default', got 'bezier'"):
        load_gate(gate)
    assert read_json(resource_path("models", "gate.json"))["action_set"] == "default"


def test_a_table_that_unpacks_to_gigabytes_is_read_without_them_or_refused(tmp_path: Path) -> None:
    rows = made_up_experience("goToPose").head(1)
    reasons = pd.Categorical.from_codes([0] * 5000, ["x" * 1_000_000])  # 5 GB, once unpacked
    many = pd.concat([rows] * 5000, ignore_index=True).assign(reason=reasons)
    write_experience(tmp_path / "table.parquet", Experience(many, {}))
    assert (tmp_path / "table.parquet").stat().st_size < 10_000_000
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read_experience(tmp_path / "table.parquet")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000  # kB


@pytest.mark.parametrize("word", ["x=1e300", "speedg=inf", "w=" + "9" * 5000])
def test_situations_beyond_reason_are_refused(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert train.main(["--rules", "goToPose", "--situation", word]) == 1
    told = capsys.readouterr().err
    assert "a number up to 1e+09" in told
    assert len(told) < 400


def test_a_gate_file_s_refusal_is_short(tmp_path: Path) -> None:
    data = json.loads(resource_path("models", "gate.json").read_text(encoding="utf-8"))
    (tmp_path / "gate.json").write_text(json.dumps({**data, "kind": "x" * 1_000_000}))
    with pytest.raises(RefinementError) as refusal:
        load_gate(tmp_path / "gate.json")
    assert len(str(refusal.value)) < 300
