"""The commands of docs/own_server.md: a package with an action server, models, demo and a goal."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from documentation import ROOT
from process import executable

PAGE = (ROOT / "docs" / "own_server.md").read_text(encoding="utf-8")


@pytest.mark.node
@pytest.mark.long
def test_own_server_is_built_driven_learned_and_refined(tmp_path: Path, domain: int) -> None:
    def run(words: str) -> str:
        command = f"[ ! -e install ] || . install/setup.sh; {words}"
        # colcon's default starves on a busy machine
        jobs = os.environ | {"MAKEFLAGS": f"-j{os.cpu_count()}"}
        done = subprocess.run(
            ["sh", "-c", command],
            cwd=tmp_path,
            env=jobs,
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    shutil.copytree(ROOT / "docs" / "shuttle", tmp_path / "src" / "shuttle")
    run("python -m colcon build")
    printed = dict(
        re.findall(r"make run EXE=(\w+) ARGS='(.*~/ws/src/shuttle/my_domain.yaml.*)'", PAGE)
    )
    small = {
        "collect": "--episodes 42 --seed 3",
        "train": "",
        "demo": "--situations 1 --out demo.png",
    }
    commands = {tool: printed[tool].replace("~/ws/", "") for tool in small}
    outputs = {
        tool: run(f"{executable(tool)} {commands[tool]} {more}") for tool, more in small.items()
    }
    assert re.search(
        r"s by cross-validation on \d+ drives( of \d+ \(others are below 0\.5 m|\n)",
        outputs["train"],
    )
    assert "three nodes and server start" in outputs["demo"]
    assert "1 of 1 situations succeeded with both chains" in outputs["demo"]

    nodes = dict(re.findall(r"make run EXE=(\w+) ARGS='(--ros-args .*)'", PAGE))
    assert set(nodes) == {"simulation", "executor", "refinement"}
    (goal,) = re.findall(r"send_goal -f (/execute_chain .*?\"\{.*?\"\n)", PAGE, re.DOTALL)
    programs = [
        f"{executable(name)} {words.replace('../ws/', '')}" for name, words in nodes.items()
    ]
    starts = "".join(
        f'{program} & pids="$pids $!"; ' for program in [*programs, "python src/shuttle/server.py"]
    )
    call = f"python {ROOT}/examples/call.py {goal.strip()}"
    output = run(f"export ROS_DOMAIN_ID={domain}; {starts} sleep 20; {call}; kill $pids; wait")
    assert "reason: go succeeded" in output
