"""The installed demo of `make demo`, complete and interrupted."""

import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from process import environment, executable, run

pytestmark = pytest.mark.node

DEMO = executable("demo")
INTERRUPTED = 130
# As fast as possible, a simulation without commands uses a whole core.
QUICKLY = ("--real-time-factor", "10")
PATIENCE = 120.0


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Start the demo of two situations; all nodes end with the test."""
    words = [DEMO, "--situations", "2", *QUICKLY, "--out", str(tmp_path / "demo.png")]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment())
    yield process
    process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE)
    process.stdout.close()


@pytest.mark.long
def test_it_prints_the_gain_and_draws_the_paths(tmp_path: Path) -> None:
    files = ("--out", tmp_path / "demo.png", "--animation", tmp_path / "race.gif")
    ended = run(DEMO, "--situations", "1", *QUICKLY, *files)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "1 of 1 situations succeeded with both chains; refinement saved" in ended.stdout
    assert (
        "chain shoot: goToBall, dribbleBall, shoot\nopen, for refinement to choose: "
        in ended.stdout
    )
    assert (
        f"{tmp_path}/demo.png: the robot's path in each situation, naive (orange)" in ended.stdout
    )
    (row,) = re.findall(r"^ *1 naive .*", ended.stdout, flags=re.MULTILINE)
    *steps, whole = map(float, re.findall(r"([\d.]+) / ", row))
    assert sum(steps) == pytest.approx(whole, abs=0.02)
    assert (tmp_path / "demo.png").read_bytes().startswith(b"\x89PNG")
    assert f"{tmp_path}/race.gif: situation 1" in ended.stdout
    assert (tmp_path / "race.gif").stat().st_size < 2_000_000


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_demo_reports_its_runs_and_leaves_no_node(
    demo: subprocess.Popen[str], tmp_path: Path, number: signal.Signals
) -> None:
    output = ""
    while not output.endswith("situation 2 of 2"):
        letter = demo.stdout.read(1)
        assert letter, f"expected a second situation, got {output}"
        output += letter
    children = Path(f"/proc/{demo.pid}/task/{demo.pid}/children").read_text().split()
    # another child ends them if the demo is killed
    nodes = [pid for pid in children if "--ros-args" in Path(f"/proc/{pid}/cmdline").read_text()]
    assert len(nodes) == 3
    demo.send_signal(number)
    output, _ = demo.communicate(timeout=PATIENCE)
    assert demo.returncode == INTERRUPTED, output
    assert "of 1 situations succeeded" in output
    assert (tmp_path / "demo.png").is_file()
    assert not [pid for pid in nodes if Path(f"/proc/{pid}").exists()]


@pytest.mark.long
def test_a_team_plays_soccer_and_delivers(tmp_path: Path) -> None:
    ended = run(DEMO, "--team", *QUICKLY, "--out", tmp_path / "team.png")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "   0.0 s: ann " in ended.stdout
    assert " driven by the last robot, " in ended.stdout
    assert (tmp_path / "team.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_a_round_of_the_building_is_drawn_in_both_orders(tmp_path: Path) -> None:
    picture = tmp_path / "round.png"
    words = ("--domain", "building", "--situations", "1", *QUICKLY, "--out", picture)
    ended = run(DEMO, *words)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "1 of 1 situations succeeded with both chains; refinement saved" in ended.stdout
    assert re.search(r"^ *1 refined\*? ", ended.stdout, flags=re.MULTILINE)
    assert picture.read_bytes().startswith(b"\x89PNG")
