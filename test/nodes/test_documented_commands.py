"""The printed commands that use ROS, verbatim; without `ros2`, ros2cli_subset.py replaces it."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from documentation import ROOT, commands

pytestmark = [pytest.mark.node, pytest.mark.long]
PATIENCE = 600.0
NODES = {
    "simulation": "simulating",
    "executor": "ready for chains of",
    "refinement": "refining chains for",
}
TEXTS = [printed.text for printed in commands()]
IGNORED = shutil.ignore_patterns(
    ".git", ".venv*", "build", "install", "log", "out", "__pycache__", ".*_cache"
)


class Shell:
    """Runs printed commands in a folder, on a ROS domain; its processes end with it."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder = folder
        self._started: list[subprocess.Popen[bytes]] = []
        path = os.environ["PATH"]
        if shutil.which("ros2") is None:
            ros2 = folder / "bin" / "ros2"
            ros2.parent.mkdir()
            subset = Path(__file__).with_name("ros2cli_subset.py")
            ros2.write_text(f'#!/bin/sh\nexec {sys.executable} {subset} "$@"\n', encoding="utf-8")
            ros2.chmod(0o755)
            path = f"{ros2.parent}:{path}"
        self._environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain),
            "PATH": path,
            "PYTHONUNBUFFERED": "1",
            "MAKEFLAGS": f"-j{os.cpu_count()}",  # colcon's default -l starves on a busy machine
        }

    def start(self, text: str, cwd: Path | None = None) -> Path:
        """Start a command in the background; return the file of its output."""
        log = self.folder / f"{len(self._started)}.log"
        with log.open("wb") as output:
            process = subprocess.Popen(
                ["/bin/sh", "-c", text],
                cwd=cwd or self.folder,
                env=self._environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._started.append(process)
        return log

    def run(self, text: str, cwd: Path | None = None) -> str:
        log = self.start(text, cwd)
        code = self._started[-1].wait(timeout=PATIENCE)
        output = log.read_text(encoding="utf-8")
        assert code == 0, f"{text}\n{output[-3000:]}"
        return output

    def close(self) -> None:
        """End all running commands and their child processes."""
        for number, patience in ((signal.SIGINT, 10.0), (signal.SIGKILL, 10.0)):
            for process in self._started:
                if process.poll() is None:
                    os.killpg(process.pid, number)
            end = time.monotonic() + patience
            while time.monotonic() < end and any(
                process.poll() is None for process in self._started
            ):
                time.sleep(0.05)


@pytest.fixture
def shell(tmp_path: Path, domain: int) -> Iterator[Shell]:
    made = Shell(tmp_path, domain)
    yield made
    made.close()


def printed(beginning: str) -> str:
    """Return the only printed command with this beginning."""
    (text,) = {text for text in TEXTS if text.startswith(beginning)}
    return text


def wait_for(words: str, log: Path) -> str:
    """Wait until the output contains these words, and return it."""
    end = time.monotonic() + PATIENCE
    while words not in (output := log.read_text(encoding="utf-8", errors="replace")):
        assert time.monotonic() < end, f"expected {words!r}, got:\n{output[-3000:]}"
        time.sleep(0.1)
    return output


def test_the_printed_requests(shell: Shell) -> None:
    nodes = shell.start(printed("ros2 launch ator_ros ator.launch.xml real_time_factor"))
    for words in ("simulating pioneer", "refining chains", "ready for chains"):
        wait_for(words, nodes)
    actions = shell.start(printed("ros2 topic echo /performance/action"))
    assert "accepted: true\nrefined: true" in shell.run(
        printed("ros2 service call /refine_subgoal")
    )
    output = shell.run(printed("ros2 action send_goal --feedback"))
    assert "feedback:" in output
    assert "arrived" in output
    assert "predicted" in wait_for("dribbleBall", actions)
    assert "arrived" in shell.run(printed("ros2 topic echo --once"))
    for beginning in ("ros2 service call /reset", "ros2 service call /place_ball"):
        assert "success: true" in shell.run(printed(beginning))
    assert "arrived" in shell.run(printed("ros2 action send_goal --feedback"))
    assert "top: shoot" in shell.run(printed("ros2 service call /plan_chains"))


def test_two_robots_drive_at_the_same_time(shell: Shell) -> None:
    started = [shell.start(printed('ros2 run ator_ros simulation --ros-args -p "robots'))]
    wait_for("simulating pioneer_3dx as ann, bob", started[0])
    for name in ("ann", "bob"):
        for node, words in (("executor", "ready for chains"), ("refinement", "refining chains")):
            started.append(
                shell.start(printed(f"ros2 run ator_ros {node} --ros-args -r __ns:=/{name}"))
            )
            wait_for(words, started[-1])
    ann = printed("ros2 action send_goal /ann")
    bob = (
        ann.replace("/ann", "/bob").partition(" {top:")[0]
        + """
      {top: goToPose, open: [yaw],
       goal: {pose: {position: {x: -0.5, y: 1.8}, orientation: {w: 1.0}}}},
      {top: goToPose, goal: {pose: {position: {x: 1.5, y: 1.2}, orientation: {w: 1.0}}}}]}}\""""
    )
    goals = [shell.start(goal) for goal in (ann, bob)]
    results = [yaml.safe_load(wait_for("result:", goal).partition("result:")[2]) for goal in goals]
    assert all(result["outcome"]["reason"].startswith("arrived") for result in results), results
    records = [result["record"] for result in results]
    starts = (record["start"]["header"]["stamp"]["sec"] for record in records)
    assert max(starts) < min(record["header"]["stamp"]["sec"] for record in records)


def test_a_copy_of_the_configuration_is_used(shell: Shell) -> None:
    shell.run(printed("cp -rL"))
    robot = shell.folder / "my_config" / "pioneer.yaml"
    assert not robot.is_symlink()
    text = (
        robot.read_text(encoding="utf-8")
        .replace("pioneer_3dx", "my_robot")
        .replace("v: 1.2 ", "v: 1.1 ")
    )
    robot.write_text(text, encoding="utf-8")
    nodes = shell.start(printed("ros2 launch ator_ros ator.launch.xml config:="))
    wait_for("simulating my_robot", nodes)
    assert "ANOTHER ROBOT" in wait_for("ready for chains", nodes)
    for node, words in NODES.items():
        text = printed(f"make run EXE={node} ARGS='--ros-args --params")
        text = text.replace("my_config", str(robot.parent))
        wait_for(f"{words} my_robot", shell.start(text, cwd=ROOT))
    shell.run(*re.findall(r"sed -i .*\\\n.*", (ROOT / "README.md").read_text(encoding="utf-8")))
    for name in ("refinement", "executor", "learning"):
        assert (
            f"models: {shell.folder}/my_study/models\n"
            in (robot.parent / f"{name}.yaml").read_text()
        )


def test_nodes_run_without_the_ros2_command(shell: Shell) -> None:
    for node, words in NODES.items():
        (text,) = {
            each for each in TEXTS if re.fullmatch(f"make run EXE={node}( .*factor.*)?", each)
        }
        wait_for(f"{words} pioneer_3dx", shell.start(text, cwd=ROOT))


def test_a_workspace_is_built(shell: Shell) -> None:
    shutil.copytree(ROOT, shell.folder / "src" / "ator_ros", ignore=IGNORED)
    shell.run(f"python -m {printed('colcon build --base-paths')}")
    launch = printed(". install/setup.sh")
    nodes = shell.start(launch)
    wait_for("ready for chains", nodes)
    prefix = shell.run(". install/setup.sh && ros2 pkg prefix --share ator_ros").strip()
    assert Path(prefix).is_relative_to(shell.folder)


def test_a_checkout_is_built_by_hand(shell: Shell) -> None:
    copy = shell.folder / "copy"
    shutil.copytree(ROOT, copy, ignore=IGNORED)
    (copy / ".venv").symlink_to(ROOT / ".venv")
    shell.run(printed("scripts/run python -m colcon build"), cwd=copy)
    assert (copy / "install" / "lib" / "ator_ros" / "executor").is_file()
