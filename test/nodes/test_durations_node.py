"""The service predict_durations of the refinement node."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from chain_client import call
from conftest import Start
from refinement_requests import save_small_models
from ros_client import Client

from ator_interfaces.msg import Situation
from ator_interfaces.srv import PredictDurations
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of

pytestmark = pytest.mark.node

STARTS = [Situation(robot=pose_of(Pose(x, 0.0, 0.0))) for x in (-2.0, 1.0)]


def test_steps_are_predicted_from_several_situations(start: Start, client: Client, tmp_path: Path) -> None:
    save_small_models(tmp_path)
    start("refinement", models=tmp_path)

    def answered(request: PredictDurations.Request) -> PredictDurations.Response:
        return client.call(PredictDurations, "predict_durations", request)

    calls = [call("goToPose", Pose(x, 0.0, 0.0)) for x in (-1.0, 0.0, 2.0)]
    found = answered(PredictDurations.Request(situations=STARTS, calls=calls))
    assert found.accepted, found.reason
    first, second = found.durations[:3], found.durations[3:]
    assert first[0] < first[1] < first[2]
    assert second[2] == min(second)
    assert len(found.spreads) == len(found.success) == 6
    assert all(map(math.isfinite, (*found.spreads, *found.success)))
    for request, reason in (
        (PredictDurations.Request(situations=STARTS), "calls: expected 1 to 100 items, got 0"),
        (
            PredictDurations.Request(situations=STARTS, calls=[call("fly", Pose(0.0, 0.0, 0.0))]),
            "calls[0].top",
        ),
    ):
        refused = answered(request)
        assert not refused.accepted
        assert reason in refused.reason
