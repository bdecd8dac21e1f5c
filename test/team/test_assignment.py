"""The assignment of roles: small cases by hand, and axioms in random ones."""

import itertools
import math

import numpy as np
import pytest

from ator_ros.geometry import FloatArray
from ator_ros.refinement.gate import NO_GATE, Gate
from ator_ros.team.assignment import Assignment, assign, waiting

NOT = math.inf
"""The cost of a role that a robot cannot take."""


def assigned(
    costs: list[list[float]],
    held: tuple[int | None, ...] | None = None,
    *,
    uncertainty: float = 0.0,
    gate: Gate | None = None,
) -> Assignment:
    """Return the assignment where every cost has the same uncertainty."""
    table = np.array(costs)
    before = (None,) * len(table) if held is None else held
    errors = np.full(table.shape, uncertainty)
    return assign(table, errors, before, Gate() if gate is None else gate)


@pytest.mark.parametrize(
    ("costs", "roles"),
    [
        ([[3.0], [2.0]], (None, 0)),
        ([[1.0, 2.0], [2.0, 5.0]], (1, 0)),  # 2 + 2 is less than 1 + 5
        ([[5.0, 1.0]], (0,)),  # too few robots: the first role is the important one
        ([[NOT, 1.0]], (1,)),
        ([[4.0, NOT], [3.0, NOT]], (None, 0)),  # no robot can take the second role
        ([[NOT], [NOT]], (None, None)),
        ([[1.0, 1.0], [9.0, NOT]], (1, 0)),  # both are filled, at any cost
        ([[math.nan, 1.0], [2.0, 1.0]], (1, 0)),
        ([[2.0, 2.0], [2.0, 2.0]], (0, 1)),  # a tie: by the order of the robots
        ([[5.0, 3.0], [5.0, 3.0]], (0, 1)),
        ([[4.0], [4.0], [4.0]], (0, None, None)),
    ],
)
def test_the_sum_of_the_costs_is_least(
    costs: list[list[float]], roles: tuple[int | None, ...]
) -> None:
    assert assigned(costs).roles == roles


@pytest.mark.parametrize(
    ("gain", "uncertainty", "changes"),
    [(0.5, 0.4, True), (0.5, 0.6, False), (0.04, 0.0, False), (0.06, 0.0, True)],
)
def test_a_role_changes_only_if_its_gain_exceeds_uncertainty_and_a_tick(
    gain: float, uncertainty: float, changes: bool
) -> None:
    one = uncertainty / math.sqrt(2.0)
    found = assigned([[3.0 + gain], [3.0]], (0, None), uncertainty=one)
    assert found.roles == ((None, 0) if changes else (0, None))
    assert found.gain == pytest.approx(0.0 if changes else gain)
    assert found.uncertainty == pytest.approx(0.0 if changes else uncertainty)


def test_the_uncertainty_is_that_of_independent_costs_which_change() -> None:
    costs = np.array([[3.1, 1.0, 9.0], [3.0, 1.0, 9.0], [9.0, 9.0, 1.0]])
    errors = np.array([[0.3, 0.4, 9.0], [1.2, 0.0, 9.0], [9.0, 9.0, 7.0]])
    found = assign(costs, errors, (0, 1, 2), Gate())
    assert found.roles == (0, 1, 2)
    assert found.uncertainty == pytest.approx(1.3)


def test_without_a_gate_every_gain_changes_roles() -> None:
    assert assigned([[3.01], [3.0]], (0, None), uncertainty=9.0, gate=NO_GATE).roles == (None, 0)


def test_a_robot_that_cannot_go_on_loses_its_role_at_once() -> None:
    assert assigned([[NOT, 1.0], [9.0, 2.0]], (0, 1), uncertainty=9.0).roles == (1, 0)


def test_of_several_robots_with_one_role_the_one_with_the_least_cost_keeps_it() -> None:
    costs = [[3.0, 1.0], [2.9, 3.0]]
    assert assigned(costs, (0, 0), uncertainty=9.0).roles == (1, 0)
    assert assigned([[2.9, 3.0], [3.0, 1.0]], (0, 0), uncertainty=9.0).roles == (0, 1)
    assert assigned([[3.0, 1.0], [3.0, 1.0]], (0, 0), uncertainty=9.0).roles == (0, 1)
    assert assigned([[NOT, 1.0], [3.0, 1.0]], (0, 0), uncertainty=9.0).roles == (1, 0)


def test_changes_that_do_not_depend_on_each_other_are_compared_one_by_one() -> None:
    costs = np.full((4, 4), 50.0)
    costs[:2, :2] = [[5.0, 1.0], [1.0, 5.0]]  # gain of a change: 8 s
    costs[2:, 2:] = [[1.3, 1.0], [1.0, 1.3]]  # 0.6 s
    found = assign(costs, np.full((4, 4), 0.5), (0, 1, 2, 3), Gate())
    assert found.roles == (1, 0, 2, 3)
    assert found.gain == pytest.approx(0.6)


def random_costs(seed: int, robots: int, roles: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    costs = rng.uniform(1.0, 9.0, (robots, roles))
    costs[rng.random(costs.shape) < 0.2] = NOT
    return costs


def most_important(costs: FloatArray) -> tuple[tuple[bool, ...], float]:
    """Return, by trying all, which roles can be filled, the important ones first, at which cost."""
    robots, roles = costs.shape
    best = ((False,) * roles, 0.0)
    for chosen in itertools.product((None, *range(roles)), repeat=robots):
        taken = [role for role in chosen if role is not None]
        total = sum(costs[robot, role] for robot, role in enumerate(chosen) if role is not None)
        if len(set(taken)) < len(taken) or not math.isfinite(total):
            continue
        filled = tuple(role in taken for role in range(roles))
        if filled > best[0] or (filled == best[0] and total < best[1]):
            best = (filled, total)
    return best


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(("robots", "roles"), [(3, 3), (2, 4), (4, 2)])
def test_no_other_assignment_is_better(seed: int, robots: int, roles: int) -> None:
    costs = random_costs(seed, robots, roles)
    chosen = assign(costs, np.zeros(costs.shape), (None,) * robots, Gate()).roles
    filled, total = most_important(costs)
    assert tuple(role in chosen for role in range(roles)) == filled
    own = sum(costs[robot, role] for robot, role in enumerate(chosen) if role is not None)
    assert own == pytest.approx(total)


@pytest.mark.parametrize("seed", range(8))
def test_the_order_of_the_robots_changes_nothing_without_ties(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = random_costs(seed, 4, 3)
    held = tuple(rng.permutation([0, 1, 2, None]).tolist())
    order = rng.permutation(4).tolist()
    errors = rng.uniform(0.1, 0.9, costs.shape)
    first = assign(costs, errors, held, Gate()).roles
    second = assign(costs[order], errors[order], [held[each] for each in order], Gate()).roles
    assert second == tuple(first[each] for each in order)


@pytest.mark.parametrize("seed", range(8))
def test_what_was_decided_is_decided_again(seed: int) -> None:
    costs = random_costs(seed, 4, 3)
    errors = np.full(costs.shape, 0.5)
    first = assign(costs, errors, (2, 1, 0, None), Gate())
    assert assign(costs, errors, first.roles, Gate()) == first


@pytest.mark.parametrize("seed", range(8))
def test_a_greater_uncertainty_changes_no_more_roles(seed: int) -> None:
    costs = random_costs(seed, 4, 4)
    held = (0, 1, 2, 3)
    gains = [
        assign(costs, np.full(costs.shape, error), held, Gate()).gain
        for error in (0.0, 0.5, 1.0, 4.0, math.inf)
    ]
    assert gains == sorted(gains)


def test_a_robot_waits_for_a_more_important_role_at_its_place() -> None:
    near = [(0.0, 0.0), (0.5, 0.0), (2.0, 0.0)]
    assert waiting((1, 0, 2), near, [0.3] * 3) == (True, False, False)
    assert waiting((0, 1, 2), near, [0.3] * 3) == (False, True, False)
    assert waiting((0, None, 2), near, [0.3] * 3) == (False, False, False)
    assert waiting((0, 1, 2), near, [0.25] * 3) == (False, False, False)


def test_robots_of_different_sizes_keep_the_distance_of_both() -> None:
    places = [(0.0, 0.0), (0.5, 0.0), (1.4, 0.0)]
    assert waiting((0, 1, 2), places, [0.2, 0.2, 0.6]) == (False, False, False)
    assert waiting((0, 1, 2), places, [0.2, 0.2, 0.8]) == (False, False, True)


def test_a_robot_that_waits_takes_no_place() -> None:
    places = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0)]
    assert waiting((0, 1, 2), places, [0.3] * 3) == (False, True, False)
