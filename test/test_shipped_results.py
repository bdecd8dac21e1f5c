"""The studies in docs/ fit the class that `study` writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ator_ros.evaluation.study import KIND, StudyResult
from ator_ros.files import content_of, read_json, save
from ator_ros.schema import structured

DOCS = Path(__file__).parents[1] / "docs"


@pytest.mark.parametrize("file", sorted((DOCS / "studies").glob("*.json")), ids=lambda file: file.stem)
def test_a_study_is_read_whole(file: Path, tmp_path: Path) -> None:
    data = read_json(file)
    result = structured(content_of(data, KIND), StudyResult, closed=True)
    assert result.robot == file.stem
    save(tmp_path / "study.json", KIND, result)
    assert json.loads((tmp_path / "study.json").read_text()) == {"variables": [], **data}
