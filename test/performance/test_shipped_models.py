"""The shipped models: complete, tested on separate episodes, and documented."""

import warnings
from pathlib import Path

import pytest

from ator_ros.bases.description import load_robot
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.resources import resource_path
from scripts.accuracy import PAPER_ERRORS, accuracy_table

ROBOT = load_robot()
MODELS = resource_path("models")
OTHERS = ("building", "drive", "tour")
FILES = [file for file in sorted(MODELS.rglob("*.json")) if file.parent.name not in OTHERS]
DOCS = Path(__file__).resolve().parents[2] / "docs"


def domain_of(file: Path) -> Domain:
    return find_domain(file.parent.name) if file.parent.name in OTHERS else SOCCER


@pytest.mark.parametrize(
    "file",
    [*FILES, MODELS / "drive" / "goToPose.json"],
    ids=lambda file: f"{file.parent.name}/{file.stem}",
)
def test_a_shipped_model_states_its_origin_and_accuracy(file: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = load_model(file, domain_of(file).robot(), domain_of(file).known_features)
    accuracy, training = model.metadata["accuracy"], model.metadata["training"]
    for name in ("mae_s", "rmse_s"):
        low, high = accuracy[f"{name}_ci95"]
        assert low < accuracy[name] < high
    assert accuracy["relative_error"] > 0.0
    assert accuracy["episodes"] >= 150
    assert training["episodes"] >= 990  # of 1000: repeated ones count once
    assert training["seed"] != accuracy["seed"]
    assert len(training["digest"]) == 16
    assert {"python", "numpy", "scikit-learn"} <= model.metadata["versions"].keys()
    assert model.action == file.stem
    expected = "default" if file.parent.name in ("models", "drive") else file.parent.name
    assert model.metadata["action_set"] == expected


def test_the_model_of_tour_is_from_few_drives_over_ros() -> None:
    tour = find_domain("tour")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = load_model(MODELS / "tour" / "drive_to.json", tour.robot(), tour.known_features)
    training, accuracy = model.metadata["training"], model.metadata["accuracy"]
    assert "--over-ros" in training["command"]
    assert training["episodes"] <= 400
    assert training["seed"] != accuracy["seed"]
    assert accuracy["relative_error"] < 0.05


def test_the_documented_accuracy_is_that_of_the_models() -> None:
    page = (resource_path("models") / "accuracy.md").read_text(encoding="utf-8")
    models = (load_model(file, ROBOT, SOCCER.known_features) for file in FILES)
    for line in accuracy_table(models, PAPER_ERRORS):
        assert line in page


WRITTEN_BY_US = sorted(resource_path("models").rglob("*.json"))


@pytest.mark.parametrize("file", WRITTEN_BY_US, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_reading_and_writing_a_shipped_file_gives_the_same_bytes(
    file: Path, tmp_path: Path
) -> None:
    copy, domain = tmp_path / file.name, domain_of(file)
    save_model(copy, load_model(file, domain.robot(), domain.known_features))
    assert copy.read_bytes() == file.read_bytes()
