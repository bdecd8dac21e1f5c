"""The demo's table and picture, its situations, and its processes, without ROS."""

import dataclasses
import math
import signal
import subprocess
import time
from pathlib import Path

import pytest
from PIL import Image
from view.in_process import record_of

from ator_interfaces.msg import Outcome
from ator_ros.bases.description import load_robot
from ator_ros.domains.declared import DeclaredServer
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.trials import random_trial
from ator_ros.nodes.network import NodesError
from ator_ros.refinement.refiner import ITS_DEADLINE
from ator_ros.tools.demo import DemoSituation, save_animation, save_picture, table
from ator_ros.tools.own_nodes import NodeProcesses
from ator_ros.tops.chain import TopChain
from ator_ros.view.runs import Answer, Run
from ator_ros.world.state import RobotState, World

ROBOT = load_robot()
TRIAL = random_trial(SOCCER, "shoot", SOCCER.library(ROBOT), seed=401, index=0)


def run(
    *, total: float, success: bool = True, refined: bool = False, refinement: str = "no gain"
) -> Run:
    durations = (3.0, 4.0, total - 7.0) if success else (3.0,)
    code = Outcome.SUCCEEDED if success else Outcome.FAILED
    given = {"refined": refined, "refinement": refinement, "reason": "lost the ball"}
    return Run("refined", record_of(*durations, code=code, duration=total, **given))


def test_the_table_shows_gains_and_failures() -> None:
    shorter = TopChain(TRIAL.chain.calls[:2])
    times = 2 * [(3.1, 4.1, math.nan)]
    answer = Answer(shorter, shorter, False, "", *times)
    whole = dataclasses.replace(answer, naive=TRIAL.chain, chain=TRIAL.chain)
    text = table(
        [
            DemoSituation(
                TRIAL.world, shorter, answer, run(total=10.0), run(total=8.0, refined=True)
            ),
            DemoSituation(
                TRIAL.world, TRIAL.chain, whole, run(total=10.0), run(total=9.0, success=False)
            ),
        ]
    )
    assert "+2.00 s (+20 %)" in text
    assert (
        "1 of 2 situations succeeded with both chains; refinement saved 2.00 s of 10.00 s (20.0 %)"
        in text
    )
    assert "situation 2, refined: lost the ball" in text
    assert "unchanged: no gain" in text
    assert "3.10 / 3.00" in text
    assert text.splitlines()[1].split()[-4:] == ["3", "shoot", "chain", "gain"]


def test_a_round_has_columns_of_stations_as_sent_and_a_picture_in_both_orders(
    tmp_path: Path,
) -> None:
    domain = find_domain("building")
    robot = domain.robot()
    trial = random_trial(domain, "round", domain.library(robot), seed=1, index=0)
    order = (5, 0, 4, 1, 3, 2)
    naive = tuple(float(number) for number in range(6))  # the predicted time of each station
    answer = Answer(
        trial.chain,
        trial.chain.reordered(order),
        True,
        "",
        before=naive,
        after=tuple(10.0 + number for number in naive),
    )
    runs = [
        Run(name, record_of(*naive, duration=15.0, refined=name == "refined"))
        for name in ("naive", "refined")
    ]
    for action, step in zip(runs[1].record.actions, order, strict=True):
        action.step = step
    situation = DemoSituation(trial.world, trial.chain, answer, *runs)
    header, first, second = table([situation]).splitlines()[1:4]
    assert header.split()[::2][:6] == ["1", "2", "3", "4", "5", "6"]
    assert first.split()[2::3][:6] == [f"{number:.2f}" for number in range(6)]
    assert second.split()[2::3][:6] == [f"{10 + number:.2f}" for number in range(6)]
    assert second.split()[4::3][:6] == [f"{order.index(number):.2f}" for number in range(6)]
    save_picture(tmp_path / "round.png", domain, robot, [situation])
    assert (tmp_path / "round.png").read_bytes().startswith(b"\x89PNG")


def test_noise_of_unchanged_chains_is_no_saving_and_short_searches_are_marked() -> None:
    shorter = TopChain(TRIAL.chain.calls[:2])
    times = 2 * [(3.1, 4.1)]
    answers = [Answer(shorter, shorter, False, "", *times, cut_short=cut) for cut in (False, True)]
    changed = run(total=8.0, refined=True)
    reason = f"gain 0.70 s ± 0.50 s: refined; {ITS_DEADLINE} cut the search short"
    cut_short = run(total=9.0, refined=True, refinement=reason)
    text = table(
        [
            DemoSituation(TRIAL.world, shorter, answers[0], run(total=10.0), run(total=9.0)),
            DemoSituation(TRIAL.world, shorter, answers[1], run(total=10.0), changed),
            DemoSituation(TRIAL.world, shorter, answers[0], run(total=10.0), cut_short),
        ]
    )
    assert "refinement saved 3.00 s of 30.00 s (10.0 %)" in text
    assert "1 unchanged " in text
    assert "2 refined* " in text
    assert "3 refined* " in text
    assert "* the deadline cut the search short" in text


def test_a_race_ends_with_the_slower_robot(tmp_path: Path) -> None:
    still = [World(0.1 * tick, TRIAL.world.robot, TRIAL.world.objects) for tick in range(5)]
    runs = [run(total=2.0), run(total=1.5, refined=True)]
    for each in runs:
        for world in still:
            each.observe(world)
        for tick in range(5, 40):
            pose = TRIAL.world.robot.pose.ahead(0.02 * (tick - 4))
            each.observe(World(0.1 * tick, RobotState(pose), TRIAL.world.objects))
    answer = Answer(TRIAL.chain, TRIAL.chain, True, "")
    situation = DemoSituation(TRIAL.world, TRIAL.chain, answer, *runs)
    save_animation(tmp_path / "race.gif", SOCCER, ROBOT, situation)
    with Image.open(tmp_path / "race.gif") as picture:
        seconds = 0.0
        for frame in range(picture.n_frames):
            picture.seek(frame)
            seconds += picture.info["duration"] / 1000.0
    assert 2.0 < seconds < 6.0  # the naive robot's time, and some to read the clocks


def test_a_command_runs_in_its_folder_and_a_missing_one_is_reported(tmp_path: Path) -> None:
    with NodeProcesses(1) as nodes:
        nodes.start_server(DeclaredServer(command=("touch", "made here"), folder=str(tmp_path)))
        end = time.monotonic() + 10.0
        while not (tmp_path / "made here").exists() and time.monotonic() < end:
            time.sleep(0.01)
        assert (tmp_path / "made here").exists()
        with pytest.raises(
            NodesError, match=r"servers: command: expected a program, got no_such_server 1: No"
        ):
            nodes.start_server(
                DeclaredServer(command=("no_such_server", "1"), folder=str(tmp_path))
            )


def test_a_node_that_exits_is_reported_with_its_last_output(tmp_path: Path) -> None:
    with NodeProcesses(1) as nodes:
        nodes.start_server(DeclaredServer(command=("sh", "-c", "echo no field here; exit 3")))
        with pytest.raises(NodesError, match="ended with exit code 3: no field here"):
            check_forever(nodes)


def test_a_signal_during_a_check_is_delayed_until_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    poll, ended = subprocess.Popen.poll, []

    def poll_with_signal(process: subprocess.Popen[bytes]) -> int | None:
        signal.raise_signal(signal.SIGINT)
        ended.append(poll(process))
        return ended[-1]

    with NodeProcesses(1) as nodes:
        nodes.start_server(DeclaredServer(command=("sleep", "60")))
        with monkeypatch.context() as patched:
            patched.setattr(subprocess.Popen, "poll", poll_with_signal)
            with pytest.raises(KeyboardInterrupt):
                nodes.check()
    assert ended == [None]


def check_forever(nodes: NodeProcesses) -> None:
    while True:
        nodes.check()
