"""Durations with a dead zone: thresholds in the rules, and chains that are refined by them."""

import itertools

import numpy as np
import pandas as pd
import pytest
from experience_rows import dead_zone_drives, dead_zone_time, whole_drives
from selection import few

from ator_ros.bases.drive_parts import DriveParts, part_times
from ator_ros.domains.domain import find_domain
from ator_ros.domains.trials import random_trial
from ator_ros.performance.features import CANDIDATES
from ator_ros.performance.model import Arrival, PerformanceModel
from ator_ros.performance.prior import prior_slopes
from ator_ros.performance.rising_terms import rising_terms, sum_of
from ator_ros.performance.training import direct_of, duration_tree, features_of, train
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
NOISE = 0.12


@pytest.fixture(scope="module")
def model() -> PerformanceModel:
    return train("drive_to", dead_zone_drives(100, seed=1, noise=NOISE), ROBOT)


def test_new_drives_are_predicted_nearly_as_well_as_their_noise_allows(
    model: PerformanceModel,
) -> None:
    fresh = dead_zone_drives(200, seed=77, noise=NOISE)
    errors = model.predict(direct_of(fresh)).duration - fresh["duration"]
    assert np.abs(errors).mean() < 1.1 * NOISE


def test_the_rules_show_the_dead_zone_and_nothing_falls(model: PerformanceModel) -> None:
    assert "*max(0, angle_to_dest - " in model.rules()
    base = model.trees["duration"].base
    assert {"dist", "angle_to_dest", "angle_at_dest"} == {hinge.feature for hinge in base}
    for name, hinges in itertools.groupby(base, key=lambda hinge: hinge.feature):
        assert min(itertools.accumulate(hinge.slope for hinge in hinges)) > -1e-9, name


def test_drives_that_begin_at_their_goals_hide_no_threshold() -> None:
    rows, near = dead_zone_drives(200, seed=1), dead_zone_drives(40, seed=2)
    near["episode"] += len(rows)
    near[["x", "y"]] = near[["xg", "yg"]] + 0.01
    near["duration"] = near["time_to_go"] = 0.3
    learned = train("drive_to", pd.concat([rows, near]), ROBOT)
    along = {
        "x": -2.0,
        "y": 0.0,
        "v": 0.0,
        "w": 0.0,
        "xg": 2.0,
        "yg": 0.0,
        "speedg": 0.0,
        "hold": 0.0,
    }
    direct = {**along, "yaw": 0.0, "yawg": np.radians([0.0, 10.0, 40.0])}
    assert learned.predict(direct).duration == pytest.approx(dead_zone_time(direct), abs=0.12)


@pytest.mark.parametrize("backward_above", few([2.0, np.pi], 2.0))
def test_fifty_whole_drives_show_how_an_action_turns_though_its_straights_vary(
    backward_above: float,
) -> None:
    rows, _ = whole_drives(50, seed=2, noise=0.6, backward_above=backward_above)
    fresh, true = whole_drives(200, seed=7, noise=0.6, backward_above=backward_above)
    situations = direct_of(fresh[fresh["t"] == 0.0])

    def error(model: PerformanceModel) -> float:
        return float(np.abs(model.predict(situations).duration - true).mean())

    learned = train("drive_to", rows, ROBOT)
    assert learned.driving is not None
    assert learned.driving.backward_above == pytest.approx(backward_above, abs=0.1)
    assert (
        error(learned)
        < 0.22
        < 0.75 * error(train("drive_to", rows.assign(**DriveParts()._asdict()), ROBOT))
    )
    # Records of the executor have the start of a drive and its parts.
    recorded = train("drive_to", rows[rows["t"] == 0.0], ROBOT)
    assert recorded.driving is not None
    assert recorded.driving.backward_above == learned.driving.backward_above
    assert recorded.rules().startswith("straights are backward if ") == (backward_above < np.pi)
    assert error(recorded) < 0.22
    # Drives whose parts are unknown do no harm.
    others = dead_zone_drives(5, seed=9).assign(episode=lambda drives: drives["episode"] + 50)
    assert error(train("drive_to", pd.concat([rows, others]), ROBOT)) < 0.25


def test_straights_that_depend_on_both_turns_are_learned_with_them() -> None:
    rows, _ = whole_drives(200, seed=4, noise=0.1)
    starts = rows[rows["t"] == 0.0]
    table, parts = features_of(starts, ROBOT, CANDIDATES, None), part_times(starts)
    prior = prior_slopes(CANDIDATES, ROBOT, None)
    parts[:, 1] += 4.0 * ((table["angle_to_dest"] > 1.5) & (table["angle_at_dest"] > 1.5))
    _, errors = duration_tree(table, parts.sum(axis=1), prior, parts)
    assert np.abs(errors).mean() < 0.6


def test_straights_may_be_slower_after_a_smaller_turn() -> None:
    rows, _ = whole_drives(200, seed=4, noise=0.05)
    starts = rows[rows["t"] == 0.0]
    table, parts = features_of(starts, ROBOT, CANDIDATES, None), part_times(starts)
    turned_on_the_spot = table["angle_to_dest"] > np.pi / 4
    parts[:, 1] += np.where(turned_on_the_spot, 0.0, 0.2)  # it begins with a curve
    base = rising_terms(table, parts, prior_slopes(CANDIDATES, ROBOT, None))
    late = parts.sum(axis=1) - sum_of(base, table)
    assert late[~turned_on_the_spot].mean() == pytest.approx(
        late[turned_on_the_spot].mean(), abs=0.05
    )


def test_accidental_drives_backward_are_not_where_an_action_begins_to_drive_backward() -> None:
    rows, _ = whole_drives(60, seed=3, noise=0.1)
    rows.loc[rows["episode"] < 2, ["v", "driven"]] *= -1.0
    driving = train("drive_to", rows, ROBOT).driving
    assert driving is not None
    assert driving.backward_above == np.pi


def test_the_distance_from_the_goal_at_which_an_action_stops_is_learned() -> None:
    rows = dead_zone_drives(100, seed=1).assign(position_error=0.12, heading_error=0.05, v=0.05)
    assert train("drive_to", rows, ROBOT).arrival == Arrival(dist=0.12, angle=0.05)


def test_an_explanation_adds_up(model: PerformanceModel) -> None:
    direct = direct_of(dead_zone_drives(1, seed=3))
    (duration,), (_, _, *parts) = model.predict(direct).duration, model.explain(direct).splitlines()
    assert sum(float(part.split()[0]) for part in parts) == pytest.approx(duration, abs=0.005)


def law(world: World, chain: TopChain) -> float:
    """Return the true duration (s) of a chain."""
    poses = [world.robot.pose, *(call.goal.pose for call in chain.calls)]
    starts, ends = np.array(poses[:-1]).T, np.array(poses[1:]).T
    return float(
        dead_zone_time(
            dict(zip(("x", "y", "yaw", "xg", "yg", "yawg"), (*starts, *ends), strict=True))
        ).sum()
    )


def test_refined_tours_take_less_time(model: PerformanceModel) -> None:
    refiner, library = Refiner(ROBOT, {"drive_to": model}), TOUR.library(ROBOT)
    gains = []
    for index in range(8):
        trial = random_trial(TOUR, "tour", library, seed=5, index=index)
        found = refiner.refine(trial.world, trial.chain, placeholders=True)
        gains.append(law(trial.world, found.original) - law(trial.world, found.chain))
    assert np.mean(gains) > 1.0
    assert min(gains) > -NOISE
