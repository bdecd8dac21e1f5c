"""Streams of chains on changed robots: resumable, and the same chains for every policy."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ator_ros.evaluation.errors import EvaluationError
from ator_ros.experience.store_reading import read_records
from ator_ros.learning.changed import CHANGES
from ator_ros.learning.sets import RECORDS
from ator_ros.learning.stream import StreamSettings
from ator_ros.learning.stream_results import play, summary
from ator_ros.report.charts import stream_gains
from ator_ros.report.terminal_tables import stream_table
from ator_ros.robot.description import load_robot
from ator_ros.tools.evaluate import main

SETTINGS = StreamSettings("motors", 5, "ball_to_goal")


def test_only_what_changed_differs() -> None:
    robot = load_robot()
    assert CHANGES["none"].robot(robot) == robot
    slow = CHANGES["motors"].robot(robot).limits
    assert (slow.a, slow.aw) == (0.7 * robot.limits.a, 0.7 * robot.limits.aw)
    assert (slow.v, slow.w, slow.brake) == (robot.limits.v, robot.limits.w, robot.limits.brake)
    assert CHANGES["lag"].robot(robot).motor_time_constant == 0.12
    rolling = [r.scene.objects["ball"].rolling_deceleration for r in (robot, CHANGES["roll"].robot(robot))]
    assert rolling[1] == rolling[0] / 2.0


def result(index: int, learning: float) -> dict:
    durations = {"naive": 12.0, "shipped": 11.5, "learning": learning, "offline": 11.0}
    return {
        "index": index,
        "durations": durations,
        "failed": [],
        "set": "a" if index else "",
        "explored": 0.0,
    }


def test_gains_are_over_naive_and_shares_of_offline() -> None:
    results = [result(0, 11.5), result(1, 11.1), result(2, 11.3)]
    told = summary(results, after=1)
    assert told["learning"]["gain_s"] == pytest.approx(0.8)
    assert told["share_of_offline"] == pytest.approx(0.8)
    assert told["learning_over_shipped_s"][0] == pytest.approx(0.3)
    assert "80 %" in stream_table({"motors": told})
    stream_gains({"motors": results})


def test_a_stream_of_other_settings_is_refused(tmp_path: Path) -> None:
    (tmp_path / "stream.jsonl").write_text("{}\n", encoding="utf-8")
    with pytest.raises(EvaluationError, match="got another"):
        next(play(SETTINGS, 1, tmp_path))


@pytest.mark.long
def test_a_stream_goes_on_where_it_was_interrupted(tmp_path: Path) -> None:
    words = ["--learning", "motors", "--seed", "444", "--offline", "50", "--out", str(tmp_path)]
    assert main([*words, "--situations", "2"]) == 0
    file = tmp_path / "motors" / "stream.jsonl"
    before = file.read_text(encoding="utf-8")
    file.write_text(before + '{"cut', encoding="utf-8")
    assert main([*words, "--situations", "4"]) == 0
    after = file.read_text(encoding="utf-8")
    assert after.startswith(before)
    assert [json.loads(line)["index"] for line in after.split("\n")[1:-1]] == [0, 1, 2, 3]
    rows = read_records(tmp_path / "motors" / RECORDS, "default").rows
    assert len(rows) == json.loads(after.split("\n")[-2])["records"] >= 4
    told = json.loads((tmp_path / "learning.json").read_text(encoding="utf-8"))["changes"]["motors"]
    assert told["chains"] == 4
