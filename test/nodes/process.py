"""The installed executables as processes on a ROS domain, for tests."""

import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from ament_index_python.packages import get_package_prefix

PATIENCE = 90.0
"""Real seconds after which an expected event counts as missing: a first node compiles for half."""


LOGS: list[Path] = []
"""Log files of the processes of the current test or file; reported if a test fails."""


def executable(name: str) -> str:
    return str(Path(get_package_prefix("ator_ros"), "lib", "ator_ros", name))


def environment(domain: int | None = None) -> dict[str, str]:
    """Return the environment of a program on a ROS domain of this machine."""
    chosen = {} if domain is None else {"ROS_DOMAIN_ID": str(domain)}
    return {
        **os.environ,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONUNBUFFERED": "1",
        **chosen,
    }


def run(*words: object, domain: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run a program to its end."""
    command, settings = list(map(str, words)), environment(domain)
    return subprocess.run(
        command, capture_output=True, text=True, timeout=240.0, env=settings, check=False
    )


class Process:
    """An installed executable with its command line; `log` is the file of its output."""

    def __init__(self, name: str, log: Path, domain: int, arguments: Sequence[str]) -> None:
        self.name, self._log = name, log
        LOGS.append(log)
        with log.open("w", encoding="utf-8") as output:
            self._process = subprocess.Popen(
                [executable(name), *arguments],
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment(domain),
            )

    @property
    def output(self) -> str:
        return self._log.read_text(encoding="utf-8")

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def wait(self) -> int:
        """Wait for the end and return the exit code."""
        return self._process.wait(timeout=PATIENCE)

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Send a signal, wait for the end, and return the exit code."""
        if self.running:
            self.send(number)
        return self.wait()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()


class Processes:
    """The executables that a test starts, with their output in `logs`; they end with the test."""

    def __init__(self, domain: int, logs: Path) -> None:
        self._domain, self._logs = domain, logs
        self._started: list[Process] = []

    def start(
        self,
        name: str,
        *,
        namespace: str = "",
        remap: Mapping[str, str] | None = None,
        log_level: str = "info",
        **parameters: object,
    ) -> Process:
        """Start the executable `name` with these ROS parameters and remapped names."""
        arguments = ["--ros-args", "--log-level", f"{name}:={log_level}"]
        for parameter, value in parameters.items():
            arguments += ["-p", f"{parameter}:={value}"]
        for old, new in (remap or {}).items():
            arguments += ["-r", f"{old}:={new}"]
        if namespace:
            arguments += ["-r", f"__ns:=/{namespace}"]
        log = self._logs / f"{name}{len(self._started)}.log"
        self._started.append(Process(name, log, self._domain, arguments))
        return self._started[-1]

    def named(self, name: str) -> list[Process]:
        """Return the processes of an executable."""
        return [process for process in self._started if process.name == name]

    def kill(self) -> None:
        for process in self._started:
            process.kill()
        LOGS.clear()
