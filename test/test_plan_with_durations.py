"""The example that plans with predicted durations."""

import re
import subprocess
import sys
from pathlib import Path

FILE = Path(__file__).parents[1] / "examples" / "plan_with_durations.py"


def test_stations_are_divided_by_each_kind_of_durations() -> None:
    command = [sys.executable, str(FILE), "--problems", "1", "--seconds", "2"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["equal", "by distance", "predicted"]
    equal, _, predicted = (float(re.findall(r"[\d.]+", line)[0]) for line in lines)
    assert predicted <= equal
