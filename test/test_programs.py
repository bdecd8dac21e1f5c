"""Programs beside the package: figures, benchmarks, and examples that use predicted durations."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from documentation import ROOT

from ator_ros.domains.drive import DRIVE
from ator_ros.evaluation.running import KIND, RESULT
from ator_ros.files import save
from benchmarks import along, omni_drives, speed
from examples.plan_with_durations import plan
from scripts import figures, rounds


def test_both_figures_are_drawn(tmp_path: Path) -> None:
    assert figures.main(["--action-set", "bezier", "--out", str(tmp_path)]) == 0
    assert "angle_at_dest (degree)" in (tmp_path / "figure4_bezier.svg").read_text()
    assert "together" in (tmp_path / "figure6_bezier.svg").read_text()


@pytest.mark.long
@pytest.mark.parametrize("part", speed.PARTS)
def test_each_part_of_the_speed_is_measured(part: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert speed.main([part, "--requests", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 2
    assert all(line.startswith((part, "longest tick")) for line in lines)


@pytest.mark.long
def test_divisions_of_a_round_are_executed_and_the_same_command_resumes(tmp_path: Path) -> None:
    results = tmp_path / "rounds.jsonl"
    words = [ROOT / "scripts" / "team_rounds.py", "tour", "--rounds", "1", "--out", results]
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, *map(str, words)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("1 rounds, 0 with a failed chain")
        assert len(results.read_text(encoding="utf-8").splitlines()) == 1


@pytest.mark.long
def test_refining_along_the_way_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert along.main(["--situations", "2"]) == 0
    once, along_the_way, gained = capsys.readouterr().out.splitlines()
    assert once.endswith(" s, 0 failed")
    assert along_the_way.endswith(" s, 0 failed")
    assert gained.startswith("gained along the way: ")


@pytest.mark.parametrize("name", omni_drives.ROBOTS)
def test_no_motion_is_predicted_to_be_faster_than_the_bound(name: str) -> None:
    robot = omni_drives.shipped(name)
    rng = np.random.default_rng(65)
    drive = DRIVE.actions()["goToPose"]
    situations = [drive.situation(robot, rng) for _ in range(200)]
    predicted = robot.fastest(omni_drives.legs_of(situations), None)[0]
    bounds = np.array([omni_drives.bound(robot, situation) for situation in situations])
    assert (predicted >= bounds - 1e-6).all()


@pytest.mark.long
@pytest.mark.parametrize(("evaluation", "code"), [("evaluation", 0), ("evaluation_shoot", 2)])
def test_chains_are_compared_with_time_optimal_ones(evaluation: str, code: int) -> None:
    pytest.importorskip("casadi")
    command = [sys.executable, ROOT / "benchmarks" / "time_optimal.py", ROOT / "docs" / evaluation]
    done = subprocess.run([*command, "--situations", "1"], capture_output=True, text=True)
    assert done.returncode == code
    assert ("refined_speed: " in done.stdout) is (code == 0)


def printed_by(example: str, *words: str) -> list[str]:
    """Return the lines that an example prints."""
    command = [sys.executable, str(ROOT / "examples" / f"{example}.py"), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()


def test_stations_are_divided_by_the_times_of_all_pairs() -> None:
    """By hand: robots at 0 and 10 on a line, stations at 8, 1 and 2; the round of 1 ends at 2."""
    places = np.array([0.0, 10.0, 8.0, 1.0, 2.0])
    times = np.abs(places[:, None] - places[None, 2:])
    assert plan(times, seconds=1.0) == [[1, 2], [0]]


@pytest.mark.long
def test_durations_are_predicted_for_the_planner() -> None:
    lines = printed_by("plan_with_durations")
    assert [line[:8] for line in lines] == ["robot 1:", "robot 2:"]
    times = [float(re.findall(r"([\d.]+) s$", line)[0]) for line in lines]
    assert max(times) < 20.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "lines"),
    [
        ("standing --situations 3", 7),
        ("driving --episodes 1 --duration 3", 4),
        ("noise --episodes 1 --duration 1", 11),
    ],
)
def test_choices_of_a_robot_are_compared(words: str, lines: int) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "team_roles.py"), *words.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) == lines


def an_evaluation(folder: Path, **durations: list[float]) -> str:
    """Write an evaluation with these durations of policies in s, and return its folder."""
    policies = {
        name: {"duration": values, "success": [True] * len(values)}
        for name, values in durations.items()
    }
    content = {
        "settings": {"source": {"domain": "tour"}},
        "summary": {"command": "evaluate"},
        "runs": {"policies": policies},
    }
    save(folder / RESULT, KIND, content)
    return str(folder)


def test_the_table_of_orders_compares_predicted_times_with_routes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By hand: of 40, 60, 51 and 40.5 s, only 51 s are more than 2 % above 44, 64, 49 and 40 s."""
    by_route = [44.0, 64.0, 49.0, 40.0]
    by_time = [40.0, 60.0, 51.0, 40.5]
    others = dict.fromkeys(set(rounds.ORDERS) - {"refined", "route_refined"}, [100.0] * 4)
    durations = others | {"naive": [100.0] * 4, "refined": by_time, "route_refined": by_route}
    folders = [an_evaluation(tmp_path / name, **durations) for name in ("first", "second")]
    rounds.main(folders)
    head, dashes, *rows, first, second = capsys.readouterr().out.splitlines()
    assert head == "| order | headings | `tour` | gain (95 %) | `tour` | gain (95 %) |"
    assert {row.count("|") for row in (head, dashes, *rows)} == {7}
    assert rows[1].startswith("| as listed | naive | 100.00 s |  | 100.00 s |")
    assert "| refined | 47.88 s | 52.1 % (" in rows[-3]
    assert "| 1.38 s | 2.8 % (" in rows[-2]
    assert rows[-1].endswith("| refined | 1 of 4 | 25.0 % | 1 of 4 | 25.0 % |")
    assert first == second == "tour: 4 rounds, 0 failed; `evaluate`"


def test_the_table_of_stops_compares_with_the_best_of_each_round(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By hand: the oracle takes 30, 38 and 36 s, so of 16 s in all refined saves 15 s."""
    folder = an_evaluation(
        tmp_path,
        naive=[60.0, 60.0, 60.0],
        stepwise=[40.0, 40.0, 40.0],
        passing=[30.0, 43.0, 41.9],
        refined=[31.0, 38.0, 36.0],
    )
    rounds.main([folder])
    _, _, stepwise, passing, refined, oracle, caption = capsys.readouterr().out.splitlines()
    assert stepwise == "| a stop at each | 40.00 s |  |  |  |"
    assert "| 1 of 3 |" in passing
    assert "| 35.00 s | 12.5 % (" in refined
    assert refined.endswith("| 0 of 3 | 94 % |")
    assert oracle.endswith("| 0 of 3 | 100 % |")
    assert caption == "tour: 3 rounds, 0 failed; `evaluate`"
