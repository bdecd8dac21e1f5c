"""The partial results of an evaluation: lines of other settings, changed lines and nonsense are refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ator_ros.evaluation.running import PARTIAL, PartialResults
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.evaluation.trials import EvaluationError


def record(index: int) -> Record:
    """Return a made-up record."""
    return {"index": index, "policies": {"naive": {"duration": 1.0 + index}}}


@pytest.mark.parametrize("kind", ["foreign", "changed", "no JSON", "no record"])
def test_lines_of_other_results_are_refused(kind: str, tmp_path: Path) -> None:
    mine, other = Settings(seed=1), Settings(seed=2)
    for name, settings in (("mine", mine), ("other", other)):
        partial = PartialResults(tmp_path / name, settings, "models")
        for index in range(2):
            partial.append(record(index))
    file = tmp_path / "mine" / PARTIAL
    lines = file.read_text().splitlines()
    foreign = (tmp_path / "other" / PARTIAL).read_text().splitlines()[2]
    changed = json.loads(lines[2])
    changed["record"]["policies"]["naive"]["duration"] = 0.5
    lines[2] = {
        "foreign": foreign,
        "changed": json.dumps(changed, separators=(",", ":")),
        "no JSON": lines[2][:-1],
        "no record": "[1]",
    }[kind]
    file.write_text("\n".join([*lines, ""]))
    with pytest.raises(
        EvaluationError, match="line 3: expected a situation's record of these settings"
    ) as told:
        PartialResults(tmp_path / "mine", mine, "models")
    assert "\n" not in str(told.value)
