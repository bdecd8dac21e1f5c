"""Warm-up: tables and compiled code are ready before the first goal."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from experience_rows import synthetic_model
from parcels import PARCELS

from ator_ros.domains.domain import Domain
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.execution.predictions import warm_up_refinement
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.robot.description import Robot, load_robot


@pytest.mark.parametrize(
    ("domain", "robot"),
    [
        (SOCCER, load_robot()),
        (SOCCER, dataclasses.replace(load_robot(), holder=None)),
        (PARCELS, load_robot()),
    ],
    ids=["with a holder", "without", "another domain"],
)
def test_each_usable_top_is_refined_once(domain: Domain, robot: Robot) -> None:
    ended: list[Refinement] = []

    class Recording(Refiner):
        """Records its answers."""

        def refine(self, *arguments: Any, **options: Any) -> Refinement:
            ended.append(super().refine(*arguments, **options))
            return ended[-1]

    models = {name: synthetic_model("goToPose", robot) for name in domain.actions()}
    library = domain.library(robot)
    warm_up_refinement(library, Recording(robot, models, ranges=domain.ranges))
    assert "yaw" in {variable.name for variable in ended[0].free}
    assert ended[0].curves
    refined = {call.top.name for refinement in ended for call in refinement.original.calls}
    assert refined == {top.name for top in library.usable()}
