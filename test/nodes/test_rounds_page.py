"""The commands of docs/rounds.md: nodes, durations from place to place, a round."""

import re
import shlex
import sys

import pytest
import yaml
from conftest import Start
from documentation import ROOT, commands
from process import PATIENCE, run
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


def stated(pattern: str, text: str = PAGE) -> list[float]:
    """Return the numbers that a pattern finds."""
    found = re.search(pattern, text)
    assert found is not None, text
    return [float(number) for group in found.groups() for number in group.split(",")]


@pytest.mark.node
@pytest.mark.long
def test_a_round_is_predicted_and_driven(start: Start, client: Client, domain: int) -> None:
    nodes = [text.split()[3:] for text in TEXTS if re.match(r"ros2 run ator_ros .* -p", text)]
    assert [name for name, *_ in nodes] == ["simulation", "executor", "refinement"]
    for name, *words in nodes:
        start(name, **dict(word.split(":=") for word in words if ":=" in word))
    client.eventually(
        lambda: {"/predict_durations", GOALS} <= services(client), "the nodes", 3.0 * PATIENCE
    )

    def called(beginning: str, change: tuple[str, str] = ("", "")) -> str:
        words = [word.replace(*change) if change[0] else word for word in printed(beginning)]
        ran = run(sys.executable, str(CALL), *words, domain=domain)
        assert ran.returncode == 0, ran.stdout + ran.stderr
        return ran.stdout

    answer = yaml.safe_load(called("ros2 service call /predict_durations"))
    assert answer["durations"] == pytest.approx(stated(r"`\[(.*?)\]`\s+in s"), abs=0.01)

    def driven(*change: str) -> str:
        called("ros2 service call /reset")
        return called("ros2 action send_goal -f ", change or ("", ""))

    times = r"([\d.]+) s\s+driven, ([\d.]+) s\s+predicted"
    order = r"refined: order ([\d,\s]+\d),\s"
    saved = r"predicted to save ([\d.]+) s"
    output = driven()
    assert stated(times, output) == pytest.approx(stated(times), abs=0.5)
    assert stated(times, output)[1] == pytest.approx(stated(times)[1], abs=0.1)
    assert stated(order, output) == stated(order)
    assert stated(saved, output) == pytest.approx(stated(saved), abs=0.1)

    seconds = r"([\d.]+) s driven"
    as_listed = driven(", order", "")
    assert stated(seconds, as_listed) == pytest.approx(
        stated(r"only headings are refined: ([\d.]+) s"), abs=0.5
    )
    passing = driven("order]", "order, speed]")
    assert stated(seconds, passing) == pytest.approx(
        stated(r"it need not stop: here ([\d.]+) s"), abs=0.5
    )
