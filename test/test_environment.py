"""`scripts/run`, and `.

scripts/env.sh` in interactive shells: the last sourced checkout applies.
"""

import shutil
import subprocess
from pathlib import Path

import pytest

ENV_SH = Path(__file__).resolve().parents[1] / "scripts" / "env.sh"
LISTS = ("PATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH")
SHELLS = [
    pytest.param(
        shell, marks=pytest.mark.skipif(shutil.which(shell) is None, reason=f"{shell} is missing")
    )
    for shell in ("bash", "dash", "zsh")
]


def checkout(folder: Path, ros: str = "wheels") -> Path:
    (folder / "scripts").mkdir(parents=True)
    shutil.copy(ENV_SH, folder / "scripts")
    (folder / ".venv" / "lib" / "python3.11").mkdir(parents=True)
    (folder / ".venv" / "ros_prefix").write_text(ros, encoding="utf-8")
    return folder


def after(shell: str, commands: str, cwd: Path, **variables: str) -> dict[str, str]:
    """Return the environment of a program that `shell` starts after `commands`."""
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(cwd), **variables}
    done = subprocess.run(
        [shell, "-c", f"{commands}\nenv -0"],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return dict(entry.split("=", 1) for entry in done.stdout.split("\0") if entry)


@pytest.fixture
def one(tmp_path: Path) -> Path:
    return checkout(tmp_path / "one")


@pytest.fixture
def two(tmp_path: Path) -> Path:
    return checkout(tmp_path / "two")


@pytest.mark.parametrize("shell", SHELLS)
def test_a_second_checkout_replaces_the_first(shell: str, one: Path, two: Path) -> None:
    alone = after(shell, f". {two}/scripts/env.sh", cwd=one)
    both = after(shell, ". scripts/env.sh; . ../two/scripts/env.sh", cwd=one)
    assert both["ATOR_ROS_ROOT"] == both["VIRTUAL_ENV"].removesuffix("/.venv") == str(two)
    assert {name: both[name] for name in LISTS} == {name: alone[name] for name in LISTS}
    assert all(both[name].startswith(str(two)) for name in LISTS)


@pytest.mark.parametrize("shell", SHELLS)
def test_a_previously_sourced_workspace_has_lower_precedence(
    shell: str, one: Path, tmp_path: Path
) -> None:
    prefix, humble = tmp_path / "ws" / "install" / "fleet", tmp_path / "humble"
    (humble / "share" / "rclpy").mkdir(parents=True)
    packages = f"{prefix}/lib/python3.11/site-packages"
    sourced = {
        "AMENT_PREFIX_PATH": f"{prefix}:{humble}:/opt/ros/humble",
        "CMAKE_PREFIX_PATH": f"{prefix}:{humble}",
        "LD_LIBRARY_PATH": f"{prefix}/lib:{humble}/lib:/usr/local/lib:relative",
        "PYTHONPATH": f"{packages}:{tmp_path}/ws/build/fleet:{humble}/lib/python3:/home/mine",
    }
    found = after(shell, ". scripts/env.sh; . scripts/env.sh", cwd=one, **sourced)
    assert found["AMENT_PREFIX_PATH"] == f"{one}/install:{one}/.venv:{prefix}"
    assert found["CMAKE_PREFIX_PATH"] == f"{one}/install:{one}/.venv:{prefix}"
    assert found["LD_LIBRARY_PATH"] == f"{one}/install/lib:{prefix}/lib:/usr/local/lib:relative"
    assert found["PYTHONPATH"].endswith(f"/site-packages:{packages}:{tmp_path}/ws/build/fleet")
    assert found["PYTHONPATH"].startswith(f"{one}/build/ator_ros:{one}/install/lib/")


@pytest.mark.long
def test_a_command_keeps_its_exit_code(tmp_path: Path) -> None:
    done = subprocess.run(
        [str(ENV_SH.with_name("run")), "sh", "-c", "exit 7"], cwd=tmp_path, check=False
    )
    assert done.returncode == 7
