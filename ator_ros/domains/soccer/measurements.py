"""What soccer measures of its actions; the modules that do so are imported when they are asked."""

from __future__ import annotations

from ator_ros.domains.measurements import Measurements, PaperRun, QualityRun, Ticks
from ator_ros.robot.description import Robot


def _longest_ticks(robot: Robot) -> Ticks:
    from ator_ros.domains.soccer.quality.longest_ticks import measure

    return measure(robot)


def _qualify(asked: QualityRun) -> None:
    from ator_ros.domains.soccer.quality.qualification import run

    run(asked)


def _paper_models(asked: PaperRun) -> str:
    from ator_ros.domains.soccer.quality.paper_models import document

    return document(asked)


MEASUREMENTS = Measurements(_longest_ticks, _qualify, _paper_models)
