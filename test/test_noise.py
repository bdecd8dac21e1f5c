"""The command line `noise`, and what it counts."""

from __future__ import annotations

from pathlib import Path

import pytest
from documentation import ROOT

from ator_ros.evaluation.chain_run import ChainRun
from ator_ros.evaluation.noise import CONDITIONS, TRUTH, NoiseTask, execute, summarise
from ator_ros.evaluation.noise_result import FORMAT, NoiseResult
from ator_ros.files import read_json
from ator_ros.schema import SchemaError, structured
from ator_ros.simulation.sensors import REALISTIC_SIGHT
from ator_ros.tools.noise import main


def run(success: bool, duration: float = 10.0, reason: str = "") -> ChainRun:
    return ChainRun(duration if success else 30.0, success, reason, (), 0.02)


def test_a_row_compares_with_the_truth_in_the_same_situations() -> None:
    results = [{TRUTH: run(True), "all": run(True, 11.0)} for _ in range(8)]
    reasons = (f"lost the ball, it is {offset} m from the front" for offset in (0.16, 0.2))
    results += [{TRUTH: run(True), "all": run(False, reason=reason)} for reason in reasons]
    truth, noisy = summarise(results)
    assert (truth.condition, truth.success_percent, truth.points_below_truth) == (TRUTH, 100.0, 0.0)
    assert (noisy.success_percent, noisy.points_below_truth) == (80.0, 20.0)
    assert (truth.within_limit, noisy.within_limit) == (True, False)
    assert noisy.mean_duration_s == pytest.approx(11.0)
    assert noisy.failures == {"lost the ball, it is # m from the front": 2}
    low, high = noisy.points_below_truth_ci95
    assert low < 20.0 < high


def test_a_situation_depends_on_seed_and_number_only() -> None:
    task = NoiseTask(412, 3, "dribble", "bearing", ("truth", "all"))
    first, again = execute(task), execute(task)
    assert first == again
    assert first["all"].actions != first["truth"].actions
    assert first["truth"].success


def test_a_file_of_the_first_version_is_read() -> None:
    shipped = read_json(ROOT / "docs" / "robustness_noise.json")
    sensors = shipped["sensors"]
    (name, sight), *_ = sensors.pop("objects").items()
    former = {**sensors, **{f"{name}_{error}": value for error, value in sight.items()}}
    first = {**shipped, "schema_version": 1, "sensors": former}
    read = structured(FORMAT.content(first), NoiseResult, closed=True)
    assert read == structured(FORMAT.content(read_json(ROOT / "docs" / "robustness_noise.json")), NoiseResult)
    assert read.sensors.objects[name].delay == 0.1
    with pytest.raises(SchemaError, match=r"^sensors: "):
        structured(FORMAT.content({**first, "sensors": 3}), NoiseResult, closed=True)
    with pytest.raises(SchemaError, match="schema_version: expected 1 to 2, got 3"):
        FORMAT.content({**first, "schema_version": 3})


def test_the_command_writes_its_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "noise.json"
    words = [
        "--situations",
        "1",
        "--seed",
        "413",
        "--jobs",
        "1",
        "--chains",
        "dribble",
        "--policy",
        "bearing",
    ]
    assert main([*words, "--conditions", "noise", "--out", str(out)]) == 0
    result = structured(FORMAT.content(read_json(out)), NoiseResult, closed=True)
    assert [row.condition for row in result.chains["dribble"]] == [TRUTH, "noise"]
    assert result.command.endswith("--out noise.json")
    assert result.sensors.objects == {"ball": REALISTIC_SIGHT}
    assert "below truth" in capsys.readouterr().out


def test_no_situations_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--situations", "0"])
    assert "expected a whole number from 1, got '0'" in capsys.readouterr().err


def test_untracked_sights_are_a_condition_of_their_own() -> None:
    assert not CONDITIONS["all, untracked"].tracked
    assert CONDITIONS["all, untracked"].sensors == CONDITIONS["all"].sensors
