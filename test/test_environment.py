"""`scripts/run`, and `. scripts/env.sh` in the shells of people: the checkout sourced last is in force."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ENV_SH = Path(__file__).resolve().parents[1] / "scripts" / "env.sh"
LISTS = ("PATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH")
SHELLS = [
    pytest.param(shell, marks=pytest.mark.skipif(shutil.which(shell) is None, reason=f"{shell} is missing"))
    for shell in ("bash", "dash", "zsh")
]


def checkout(folder: Path, ros: str = "wheels") -> Path:
    """Make what env.sh needs of a checkout."""
    (folder / "scripts").mkdir(parents=True)
    shutil.copy(ENV_SH, folder / "scripts")
    (folder / ".venv" / "lib" / "python3.11").mkdir(parents=True)
    (folder / ".venv" / "ros_prefix").write_text(ros, encoding="utf-8")
    return folder


def after(shell: str, commands: str, cwd: Path, **variables: str) -> dict[str, str]:
    """Return the environment that a program sees which `shell` starts after `commands`."""
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
@pytest.mark.parametrize("place", ["{two}/scripts/env.sh", "../two/scripts/env.sh"])
def test_a_second_checkout_replaces_the_first(shell: str, place: str, one: Path, two: Path) -> None:
    alone = after(shell, f". {two}/scripts/env.sh", cwd=one)
    both = after(shell, f". scripts/env.sh; . {place.format(two=two)}", cwd=one)
    assert both["ATOR_ROS_ROOT"] == both["VIRTUAL_ENV"].removesuffix("/.venv") == str(two)
    assert {name: both[name] for name in LISTS} == {name: alone[name] for name in LISTS}
    assert all(both[name].startswith(str(two)) for name in LISTS)


@pytest.mark.parametrize("shell", SHELLS)
def test_also_in_a_shell_that_the_first_started(shell: str, one: Path, two: Path) -> None:
    inner = after(shell, f". scripts/env.sh; {shell} -c '. {two}/scripts/env.sh; env -0'; exit", cwd=one)
    assert inner["ATOR_ROS_ROOT"] == str(two)
    assert str(one) not in "".join(inner[name] for name in LISTS)


@pytest.mark.parametrize("shell", SHELLS)
def test_twice_is_once(shell: str, one: Path) -> None:
    once = after(shell, ". scripts/env.sh", cwd=one)
    twice = after(shell, "( . scripts/env.sh; . scripts/env.sh; env -0 ); exit", cwd=one)
    assert {name: twice[name] for name in LISTS} == {name: once[name] for name in LISTS}


@pytest.mark.parametrize("shell", SHELLS)
def test_a_workspace_that_was_sourced_before_stays_behind_ours(shell: str, one: Path, tmp_path: Path) -> None:
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


def test_without_a_workspace_pythonpath_is_ours_alone(one: Path) -> None:
    alone = after("sh", ". scripts/env.sh", cwd=one)
    found = after("sh", ". scripts/env.sh", cwd=one, PYTHONPATH="/home/mine:/opt/ros/humble/lib/python3")
    assert found["PYTHONPATH"] == alone["PYTHONPATH"]


def test_a_ros_that_was_sourced_before_stays(tmp_path: Path, two: Path) -> None:
    one = checkout(tmp_path / "apt", ros="/opt/ros/jazzy")
    ros = {"AMENT_PREFIX_PATH": "/opt/ros/jazzy", "PYTHONPATH": "/opt/ros/jazzy/lib/python3.12/site-packages"}
    both = after("sh", f". {one}/scripts/env.sh; . {one}/scripts/env.sh", cwd=two, **ros)
    assert both["AMENT_PREFIX_PATH"] == f"{one}/install:/opt/ros/jazzy"
    assert both["PYTHONPATH"].endswith("/site-packages:/opt/ros/jazzy/lib/python3.12/site-packages")
    assert both["PYTHONPATH"].count(str(one)) == 2


@pytest.mark.long
def test_a_command_keeps_its_exit_code(tmp_path: Path) -> None:
    done = subprocess.run([str(ENV_SH.with_name("run")), "sh", "-c", "exit 7"], cwd=tmp_path, check=False)
    assert done.returncode == 7
