"""The objective: a weighted sum of predicted measures."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.refinement import RefinementError
from ator_ros.refinement.objective import LEAST_WEIGHT, MOST_WEIGHT, Objective, expected_time

WEIGHT = st.floats(LEAST_WEIGHT, MOST_WEIGHT)
PREDICTION = SimpleNamespace(
    duration=np.array([2.0, 3.0]), success=np.array([1.0, 0.75]), accuracy=np.array([0.1, 0.0])
)


@given(WEIGHT, WEIGHT, WEIGHT)
def test_the_cost_is_the_weighted_sum_of_time_failure_and_error(
    duration: float, success: float, accuracy: float
) -> None:
    objective = Objective({"duration": duration, "success": success, "accuracy": accuracy})
    cost = objective.cost(PREDICTION)
    assert cost == pytest.approx([2.0 * duration + 0.1 * accuracy, 3.0 * duration + 0.25 * success])


def test_only_measures_with_a_weight_are_needed() -> None:
    objective = Objective({"duration": 1.0, "success": 0.0, "accuracy": 2.0})
    assert objective.needs == ("duration", "accuracy")
    assert objective.of_unknown_uncertainty == ("accuracy",)
    assert Objective().needs == ("duration",)
    assert objective.cost(SimpleNamespace(duration=1.0, accuracy=0.5)) == 2.0


def test_expected_delays_cost_as_much_as_durations() -> None:
    late = SimpleNamespace(duration=np.array([2.0, 3.0]), delay=np.array([0.5, 0.0]))
    assert Objective({"duration": 2.0}).cost(late) == pytest.approx([5.0, 6.0])


@pytest.mark.parametrize("weight", [LEAST_WEIGHT, MOST_WEIGHT])
def test_weights_have_bounds(weight: float) -> None:
    assert Objective({"duration": weight}).needs == ("duration",)
    beyond = weight * (0.9 if weight < 1.0 else 1.1)
    with pytest.raises(RefinementError, match="that is 0 or from 1e-06 to 1e\\+06, got"):
        Objective({"duration": beyond})


def test_the_usual_cost_counts_failures_where_they_are_predicted() -> None:
    usual = expected_time(30.0)
    assert usual.cost(PREDICTION) == pytest.approx([2.0, 3.0 + 0.25 * 30.0])
    assert usual.cost(SimpleNamespace(duration=2.0, success=None)) == 2.0
    assert usual.of_unknown_uncertainty == ()
    only = Objective({"success": 1.0}, frozenset({"success"}))
    with pytest.raises(RefinementError, match="models that predict success, got none"):
        only.cost(SimpleNamespace(success=None))
    with pytest.raises(RefinementError, match="models that predict duration, got none"):
        usual.cost(SimpleNamespace(success=1.0))
