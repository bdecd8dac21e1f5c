"""The commands of docs/rounds.md: nodes, durations from place to place, a round."""

import re
import shlex
import sys

import pytest
import yaml
from conftest import Start
from documentation import ROOT, commands
from process import run
from ros_client import Client

PAGE = (ROOT / "docs" / "rounds.md").read_text(encoding="utf-8")
TEXTS = [printed.text for printed in commands() if printed.page == "rounds.md"]
CALL = ROOT / "examples" / "call.py"
GOALS = "/execute_chain/_action/send_goal"


def services(client: Client) -> set[str]:
    return {name for name, _ in client.node.get_service_names_and_types()}


def printed(beginning: str) -> list[str]:
    """Return the arguments for call.py of the only printed command with this beginning."""
    (text,) = (text for text in TEXTS if text.startswith(beginning))
    return shlex.split(text)[3:]


@pytest.mark.node
@pytest.mark.long
def test_a_round_is_predicted_and_driven(start: Start, client: Client, domain: int) -> None:
    nodes = [
        text.split()[3] for text in TEXTS if text.startswith("ros2 run ator_ros") and "-p" in text
    ]
    assert nodes == ["simulation", "executor", "refinement"]
    start("simulation", domain="drive", real_time_factor=5.0)
    start("executor", domain="drive", odom_timeout=5.0, refinement_timeout=10.0)
    start("refinement", domain="drive")
    client.eventually(lambda: {"/predict_durations", GOALS} <= services(client), "the nodes")

    def called(beginning: str, change: tuple[str, str] = ("", "")) -> str:
        words = [word.replace(*change) if change[0] else word for word in printed(beginning)]
        ran = run(sys.executable, str(CALL), *words, domain=domain)
        assert ran.returncode == 0, ran.stdout + ran.stderr
        return ran.stdout

    answer = yaml.safe_load(called("ros2 service call "))
    stated = re.search(r"`\[(.*?)\]` in s", PAGE)
    assert stated is not None
    assert answer["durations"] == pytest.approx(
        [float(part) for part in stated[1].split(",")], abs=0.01
    )

    line = called("ros2 action send_goal -f ")
    stated = re.search(r"([\d.]+) s driven, ([\d.]+) s\s+predicted; refined", PAGE)
    assert stated is not None
    times = re.search(r"([\d.]+) s driven, ([\d.]+) s predicted; refined: .* at step 1", line)
    assert times is not None, line
    assert float(times[2]) == pytest.approx(float(stated[2]), abs=0.1)
    assert float(times[1]) == pytest.approx(float(stated[1]), abs=0.5)

    passing = called("ros2 action send_goal -f ", ("open: [yaw]", "open: [yaw, speed]"))
    assert re.search(r"2[78]\.\d\d s driven", passing), passing
    assert "arrived" in called("ros2 action send_goal /")
