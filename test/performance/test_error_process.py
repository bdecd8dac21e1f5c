"""The Gaussian process of errors, compared with its formulas."""

import dataclasses
import math

import numpy as np
import pytest

from ator_ros.geometry import FloatArray
from ator_ros.performance.error_process import (
    TIMING,
    ErrorProcess,
    UnknownSlope,
    fit_error_process,
    robust_spread,
)
from ator_ros.performance.prior import Slope
from ator_ros.schema import SchemaError

PROCESS = ErrorProcess(
    features=("dist", "angle"),
    center=(2.0, 1.0),
    scale=(0.5, 2.0),
    points=((0.0, 0.0), (1.0, -1.0), (0.3, 2.0)),
    errors=(0.2, -0.1, 0.4),
    signal=0.3,
    noise=0.1,
    length=1.5,
    slopes=(),
)
PRIOR = {"a": Slope(2.0, 0.6), "b": Slope(1.0, 2.0, 0.2)}
AT = np.array([[2.1, 1.4], [3.0, -2.0], [2.0, 1.0]])
FAR = np.array([[1e4, 1.0]])


def kernel(one: FloatArray, other: FloatArray) -> FloatArray:
    distance = np.linalg.norm(one[:, None] - other, axis=2)
    scaled = math.sqrt(3.0) * distance / PROCESS.length
    return np.asarray(PROCESS.signal**2 * (1.0 + scaled) * np.exp(-scaled))


def test_mean_and_variance_are_those_of_the_formulas() -> None:
    known = np.array(PROCESS.points)
    points = (AT - PROCESS.center) / PROCESS.scale
    signs = np.array([1.0, -1.0, 2.0])
    inverse = np.linalg.inv(kernel(known, known) + PROCESS.noise**2 * np.eye(3))
    similar = kernel(points, known)
    mean = signs @ similar @ inverse @ PROCESS.errors
    covariance = kernel(points, points) - similar @ inverse @ similar.T
    assert PROCESS.of_sum(AT, signs) == pytest.approx((mean, signs @ covariance @ signs))


def test_far_from_all_episodes_any_error_of_the_signal_is_possible() -> None:
    assert PROCESS.of_sum(FAR, np.ones(1)) == pytest.approx((0.0, PROCESS.signal**2))


def test_a_difference_of_equal_situations_has_no_error() -> None:
    same = np.array([[2.3, 0.5], [2.3, 0.5]])
    mean, variance = PROCESS.of_sum(same, np.array([1.0, -1.0]))
    assert mean == pytest.approx(0.0, abs=1e-12)
    assert variance == pytest.approx(0.0, abs=1e-12)
    assert variance >= 0.0
    both = PROCESS.of_sum(same, np.ones(2))
    one = PROCESS.of_sum(same[:1], np.ones(1))
    assert both == pytest.approx((2.0 * one[0], 4.0 * one[1]))


def test_little_noise_makes_the_known_errors_certain() -> None:
    exact = dataclasses.replace(PROCESS, noise=1e-6)
    known = np.array(PROCESS.points) * PROCESS.scale + PROCESS.center
    for point, error in zip(known, PROCESS.errors, strict=True):
        mean, variance = exact.of_sum(point[None], np.ones(1))
        assert mean == pytest.approx(error, abs=1e-3)
        assert variance < 1e-4


def test_the_fields_must_fit_each_other() -> None:
    with pytest.raises(SchemaError, match="2 numbers each"):
        dataclasses.replace(PROCESS, center=(1.0,))
    with pytest.raises(SchemaError, match="2 numbers each"):
        dataclasses.replace(PROCESS, scale=(1.0, 1.0, 1.0))
    with pytest.raises(SchemaError, match="2 numbers each"):
        dataclasses.replace(PROCESS, points=((1.0,), (1.0, 2.0), (1.0, 2.0)))
    with pytest.raises(SchemaError, match="features of the process"):
        dataclasses.replace(PROCESS, slopes=(UnknownSlope("other", 1.0),))
    with pytest.raises(SchemaError, match="one for each point"):
        dataclasses.replace(PROCESS, errors=(0.1,))
    most = dataclasses.replace(PROCESS, points=((0.0, 0.0),) * 300, errors=(0.1,) * 300)
    assert len(most.points) == 300
    with pytest.raises(SchemaError, match="at most 300 episodes"):
        dataclasses.replace(PROCESS, points=((0.0, 0.0),) * 301, errors=(0.1,) * 301)


def drawn(count: int, *, signal: float, noise: float) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(12)
    features = rng.uniform([0.0, -3.0], [4.0, 3.0], (count, 2))
    errors = signal * np.sin(1.2 * features[:, 0]) + noise * rng.normal(size=count)
    return features, errors


def test_a_fit_finds_errors_that_depend_on_the_features() -> None:
    features, errors = drawn(150, signal=0.5, noise=0.05)
    process = fit_error_process(PRIOR, features, errors)
    assert process.noise < 0.15 < process.signal
    fresh = np.array([[1.3, 0.0], [3.9, 1.0]])
    expected = 0.5 * np.sin(1.2 * fresh[:, 0])
    for point, error in zip(fresh, expected, strict=True):
        mean, variance = process.of_sum(point[None], np.ones(1))
        assert mean == pytest.approx(error, abs=0.12)
        assert variance < 0.03
    assert process.center == pytest.approx(tuple(features.mean(axis=0)))
    assert process.scale == pytest.approx(tuple(features.std(axis=0)))
    assert 0.2 * math.sqrt(2.0) <= process.length <= math.sqrt(2.0)


@pytest.mark.parametrize(("count", "share"), [(30, 0.5), (160, 0.25)])
def test_pure_noise_of_few_drives_keeps_a_share_of_its_spread_as_signal(
    count: int, share: float
) -> None:
    features, errors = drawn(count, signal=0.0, noise=0.2)
    process = fit_error_process(PRIOR, features, errors)
    spread = robust_spread(errors)
    assert process.signal >= 0.999 * share * spread
    assert process.noise == pytest.approx(spread, rel=0.4)


def test_ignorance_grows_with_the_distance_along_what_was_never_varied() -> None:
    features, errors = drawn(50, signal=0.0, noise=0.05)
    features[:, 0] = 2.0
    process = fit_error_process(PRIOR, features, errors)
    near, far, farther = process.deviations(np.array([[2.0, 1.0], [12.0, 1.0], [22.0, 1.0]]))
    assert near < 0.1
    slope = PRIOR["a"].deviation
    assert (far, farther) == pytest.approx((10.0 * slope, 20.0 * slope), rel=0.01)


def test_drives_show_the_slope_along_what_they_vary() -> None:
    features, errors = drawn(50, signal=0.0, noise=0.05)
    process = fit_error_process(PRIOR, features, errors)
    known = process.deviations(np.array([[12.0, 1.0]]))[0]
    assert known < 0.1 * 10.0 * PRIOR["a"].deviation


def test_slopes_of_an_angle_beyond_the_drives_are_unknown_piece_by_piece() -> None:
    features, errors = drawn(50, signal=0.0, noise=0.05)
    features[:, 1] = 0.0
    process = fit_error_process(PRIOR, features, errors)
    slope = PRIOR["b"]
    one_piece, four_pieces = process.deviations(
        np.array([[2.0, slope.bend], [2.0, 4 * slope.bend]])
    )
    piece = slope.bend * slope.deviation
    assert one_piece == pytest.approx(piece, rel=0.05)
    assert four_pieces == pytest.approx(2.0 * piece, rel=0.05)


@pytest.mark.parametrize(("least", "known"), [(4.0, True), (6.0, False)])
def test_turns_to_both_sides_are_alike_near_no_turn(least: float, known: bool) -> None:
    features, errors = drawn(100, signal=0.0, noise=0.05)
    features[:, 1] = np.radians(np.linspace(least, 180.0, 100))
    process = fit_error_process(PRIOR, features, errors)
    assert (process.slopes[-1].ends is None) is known


def test_what_two_drives_share_is_not_unknown_of_their_difference() -> None:
    features, errors = drawn(50, signal=0.0, noise=0.05)
    features[:, 0] = 2.0
    process = fit_error_process(PRIOR, features, errors)
    same_length = np.array([[30.0, -1.0], [30.0, 1.0]])
    _, variance = process.of_sum(same_length, np.array([1.0, -1.0]))
    assert math.sqrt(variance) < 0.02 * process.deviations(same_length)[0]


def test_constant_features_do_no_harm() -> None:
    features, errors = drawn(50, signal=0.0, noise=0.2)
    features[:, 1] = 3.0
    process = fit_error_process(PRIOR, features, errors)
    assert process.errors == pytest.approx(errors, abs=1e-4)
    assert process.scale[1] == 1.0
    assert {point[1] for point in process.points} == {0.0}


def test_an_accident_has_little_effect() -> None:
    features, errors = drawn(80, signal=0.0, noise=0.1)
    usual = fit_error_process(PRIOR, features, errors)
    errors[40] = 50.0
    process = fit_error_process(PRIOR, features, errors)
    assert process.signal < 3.0 * usual.signal
    assert abs(process.of_sum(features[40:41], np.ones(1))[0]) < 0.3


def test_a_spread_is_that_of_a_normal_distribution_without_its_outliers() -> None:
    values = np.random.default_rng(1).normal(3.0, 0.5, 4001)
    assert robust_spread(values) == pytest.approx(0.5, rel=0.05)
    values[:200] = 1e6
    assert robust_spread(values) == pytest.approx(0.5, rel=0.15)
    assert robust_spread(np.ones(5)) == TIMING
