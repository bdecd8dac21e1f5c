"""The results in docs/ fit the classes that the tools write and read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from ator_ros.domains.soccer.quality import quality_result
from ator_ros.domains.soccer.quality.qualification import document
from ator_ros.evaluation import noise_result, study_result
from ator_ros.files import read_json
from ator_ros.formats import Format
from ator_ros.schema import structured, unstructured
from ator_ros.tools.work import bench_report, comparison, soak_result

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

DOCS = Path(__file__).parents[1] / "docs"
RESULTS: dict[str, tuple[Format, type[DataclassInstance]]] = {
    "actions": (quality_result.FORMAT, quality_result.QualityResult),
    "actions_bezier": (quality_result.FORMAT, quality_result.QualityResult),
    "benchmarks": (bench_report.FORMAT, bench_report.BenchReport),
    "compare": (comparison.FORMAT, comparison.ComparisonResult),
    "compare_predictions": (comparison.FORMAT, comparison.ComparisonResult),
    "robustness_noise": (noise_result.FORMAT, noise_result.NoiseResult),
    "soak": (soak_result.FORMAT, soak_result.SoakReport),
    "soak_realtime": (soak_result.FORMAT, soak_result.SoakReport),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_read_whole_and_would_be_written_again(name: str) -> None:
    form, schema = RESULTS[name]
    data = read_json(DOCS / f"{name}.json")
    result = structured(form.content(data), schema, closed=True)
    assert json.loads(form.text(unstructured(result))) == data


@pytest.mark.parametrize("file", sorted((DOCS / "studies").glob("*.json")), ids=lambda file: file.stem)
def test_a_study_is_read_whole(file: Path) -> None:
    data = read_json(file)
    result = structured(study_result.FORMAT.content(data), study_result.StudyResult, closed=True)
    assert result.robot == file.stem
    assert json.loads(study_result.FORMAT.text(unstructured(result))) == {"variables": [], **data}


@pytest.mark.parametrize("name", ["actions", "actions_bezier"])
def test_the_document_of_the_actions_is_made_of_their_result(name: str) -> None:
    data = quality_result.FORMAT.content(read_json(DOCS / f"{name}.json"))
    text = document(structured(data, quality_result.QualityResult))
    assert text == (DOCS / f"{name}.md").read_text(encoding="utf-8")
