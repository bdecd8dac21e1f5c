"""Fixtures of the node tests: a ROS domain for every test, processes on it, and a client."""

import gc
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import pytest
from hall import DOMAIN, Hall
from hosted import Hosted
from process import LOGS, Process, Processes
from ros_client import Client

from ator_ros.nodes.network import PROFILES, free_domain

_SHOWN = 3000  # characters of each log

Start = Callable[..., Process]
Host = Callable[..., Hosted]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests with nodes."""
    for item in items:
        ours = item.path.is_relative_to(Path(__file__).parent)
        if ours and {"domain", "shared"} & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.node)


def pytest_collection_finish() -> None:
    """Exempt imported modules from the collections after each test, which then take a tenth."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Report the output of the nodes if a test fails."""
    report = yield
    if report.failed:
        tails = [
            (log.name, log.read_text(encoding="utf-8")[-_SHOWN:]) for log in LOGS if log.exists()
        ]
        report.sections += [(f"Log {name}", tail) for name, tail in tails]
    return report


@pytest.fixture
def domain() -> Iterator[int]:
    """Yield a ROS domain that no other test uses at the same time, in this run or another."""
    with free_domain() as number:
        yield number
    # A node with an action client is in a reference cycle. Until it is collected, it is a DDS
    # participant; participants with numbers from 32 on are not discovered.
    gc.collect()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Processes, Client]]:
    """Yield processes and a client for all tests of a file, on a ROS domain of their own."""
    with free_domain() as number:
        processes, made = Processes(number, tmp_path_factory.mktemp("logs")), Client(number)
        yield processes, made
        made.close()
        processes.kill()


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Start]:
    """Yield a function that starts executables: start("simulation", namespace="a", …)."""
    processes = Processes(domain, tmp_path)
    yield processes.start
    processes.kill()


@pytest.fixture
def host(
    domain: int, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Host]:
    """Yield a function that runs one node in this process: host("executor", models=folder)."""
    monkeypatch.setenv(PROFILES, "")  # restored after the test, since the node sets it
    hosted: list[Hosted] = []

    def output() -> str:
        captured = capfd.readouterr()
        return captured.out + captured.err

    def run(name: str, /, *words: str, **parameters: object) -> Hosted:
        assert not hosted
        hosted.append(Hosted(name, domain, output, *words, **parameters))
        return hosted[0]

    yield run
    for node in hosted:
        node.close()


@pytest.fixture
def client(domain: int, request: pytest.FixtureRequest) -> Iterator[Client]:
    """Yield a client in no namespace, with the options `CLIENT` of the test's file."""
    made = Client(domain, **getattr(request.module, "CLIENT", {}))
    yield made
    made.close()


@pytest.fixture
def hall(client: Client, host: Host, tmp_path: Path) -> Iterator[Hall]:
    """Yield a base, a server that moves it, and an executor with their domain."""
    file = tmp_path / "errands.yaml"
    file.write_text(DOMAIN, encoding="utf-8")
    host("executor", domain=file, odom_timeout=2.0, start_timeout=1.0)
    made = Hall(client)
    yield made
    made.close()
