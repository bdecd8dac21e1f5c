"""Identification of a base's latency, lag, limits and dead zone from a probe drive of 30 s."""

import dataclasses
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from ator_ros.bases.description import Robot, load_robot
from ator_ros.bases.differential.calibration import described, report
from ator_ros.bases.differential.identification import BaseEstimate, check_plausible, identify
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.probe_drive import DriveError, DrivePart, DriveSample, ProbeDrive
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.simulation.sensors import SensorConfig, Sensors
from ator_ros.world.state import Command, RobotState

PIONEER = load_robot()
SLOW = Limits(v=0.4, w=1.2, a=0.3, brake=0.4, aw=2.0)
MIDDLING = Limits(v=0.8, w=1.8, a=0.6, brake=0.6, aw=2.5)
AT_REST = RobotState(Pose(0.0, 0.0, 0.0))
QUICK = Limits(v=1.6, w=4.0, a=2.0, brake=2.0, aw=8.0)


def base(limits: Limits, lag: float) -> Robot:
    return dataclasses.replace(PIONEER, limits=limits, motor_time_constant=lag)


def driven(
    robot: Robot, *, latency: float = 0.0, dead: float = 0.0, noise: float = 0.0
) -> Sequence[DriveSample]:
    """Return the samples of a probe drive in the simulation."""
    rng = np.random.default_rng(1)
    drive = ProbeDrive(v=1.5 * robot.limits.v, w=1.5 * robot.limits.w, space=3.0)
    sensors, last = Sensors(SensorConfig(latency=latency)), -1.0
    with Simulation(robot) as simulation:
        while True:
            world = sensors.observe(simulation.world())
            if world.time > last:
                last, state = world.time, world.robot
                errors = rng.normal(0.0, noise, 2)
                measured = dataclasses.replace(
                    state, vx=state.vx + errors[0], w=state.w + errors[1]
                )
                command = drive.command(world.time, measured)
                if command is None:
                    return drive.samples
                simulation.command(command if abs(command.vx) >= dead else Command(0.0, command.w))
            simulation.tick()


def check(estimate: BaseEstimate, robot: Robot, latency: float, *, within: float = 0.01) -> None:
    assert estimate.latency == pytest.approx(latency, abs=within)
    assert estimate.lag == pytest.approx(robot.motor_time_constant, abs=0.015)
    for name in ("v", "w", "a", "brake", "aw"):
        expected = getattr(robot.limits, name)
        assert getattr(estimate.limits, name) == pytest.approx(expected, rel=0.05), name
    assert estimate.driving.limited
    assert estimate.turning.limited


@pytest.mark.parametrize(
    ("limits", "lag", "latency"),
    [(PIONEER.limits, 0.12, 0.1), (SLOW, 0.03, 0.15), (QUICK, 0.02, 0.1), (QUICK, 0.02, 0.0)],
)
def test_a_base_is_identified(limits: Limits, lag: float, latency: float) -> None:
    robot = base(limits, lag)
    check(identify(driven(robot, latency=latency)), robot, latency)


def test_noisy_velocities_cause_small_errors() -> None:
    robot = base(MIDDLING, 0.08)
    check(identify(driven(robot, latency=0.1, noise=0.01)), robot, 0.1, within=0.015)


def test_a_dead_zone_is_identified() -> None:
    estimate = identify(driven(base(PIONEER.limits, 0.03), dead=0.055))
    assert estimate.driving.dead_zone == pytest.approx(0.05)
    assert estimate.turning.dead_zone == 0.0


def test_the_drive_stays_within_its_space() -> None:
    robot, places = base(PIONEER.limits, 0.03), []
    drive = ProbeDrive(v=1.8, w=3.6, space=1.5)
    with Simulation(robot) as simulation:
        while (command := drive.command(simulation.time, simulation.world().robot)) is not None:
            places.append(simulation.world().robot.pose.x)
            simulation.command(command)
            simulation.tick()
    assert max(places) < 1.5
    assert min(places) > -0.5
    assert not identify(drive.samples).driving.limited  # too short to reach the maximum speed


def test_an_unreached_limit_is_the_maximum_speed_in_the_odometry() -> None:
    samples = [
        DriveSample(
            part,
            0.05 * tick,
            Command(v, w),
            RobotState(
                Pose(0.0, 0.0, 0.0), 0.4 * 0.05 * tick * (v > 0.0), 0.4 * 0.05 * tick * (w > 0.0)
            ),
        )
        for part, v, w in (
            (DrivePart.SPRINT_V, 9.0, 0.0),
            (DrivePart.CREEP_V, 0.1, 0.0),
            (DrivePart.SPRINT_W, 0.0, 9.0),
            (DrivePart.CREEP_W, 0.0, 0.1),
        )
        for tick in range(40)
    ]
    estimate = identify(samples)
    assert not estimate.turning.limited
    assert estimate.limits.w == pytest.approx(0.4 * 1.95, rel=0.01)
    assert any(
        line.startswith("limits.w: 0.780 rad/s is the fastest speed in")
        for line in report(estimate)
    )
    with pytest.raises(
        DriveError, match=r"limits\.v: expected at least half of .* 9\.00 m/s, got 0\.7"
    ):
        check_plausible(estimate)


def test_a_base_that_does_not_move_is_reported() -> None:
    drive = ProbeDrive(v=1.0, w=1.0, space=3.0)
    still = RobotState(Pose(0.0, 0.0, 0.0))
    with pytest.raises(DriveError, match=r"does not move: expected motion within 1\.5 s"):
        deque((drive.command(0.05 * tick, still) for tick in range(2000)), maxlen=0)


def probed(
    acceleration: float,
    rate: float,
    *,
    noise: float = 0.0,
    point: tuple[float, float] = (0.0, 0.0),
    v: float = 0.7,
    w: float = 1.5,
    response: Callable[[Command], Command] = lambda command: command,
    bias: tuple[float, float] = (0.0, 0.0),
) -> Sequence[DriveSample]:
    """Return samples of a base that ramps its speeds without a lag; in m/s^2 and Hz.

    Its odometry is that of a `point` in m ahead and to the left of the axle; its speeds have a
    `bias` in m/s and rad/s.
    """
    rng = np.random.default_rng(3)
    drive, robot, tick = ProbeDrive(v=v, w=w, space=3.0), RobotState(Pose(0.0, 0.0, 0.0)), 0
    while True:
        errors = rng.normal(0.0, noise, 2)
        pose = robot.pose.compose(Pose(*point, 0.0))
        shown = RobotState(pose, robot.vx + errors[0] + bias[0], robot.w + errors[1] + bias[1])
        command = drive.command(tick / rate, shown)
        if command is None:
            return drive.samples
        target, tick = response(command), tick + 1
        change, turning = acceleration / rate, 4.0 * acceleration / rate
        next_v = robot.vx + float(np.clip(target.vx - robot.vx, -change, change))
        next_w = robot.w + float(np.clip(target.w - robot.w, -turning, turning))
        moved = Pose(0.5 * (robot.vx + next_v) / rate, 0.0, 0.5 * (robot.w + next_w) / rate)
        robot = RobotState(robot.pose.compose(moved), next_v, next_w)


def greatest_speeds(samples: Sequence[DriveSample]) -> list[float]:
    """Return the greatest speeds in m/s and rad/s of the sprints to and fro, and of both spins."""
    v = [sample.robot.vx for sample in samples if sample.part is DrivePart.SPRINT_V]
    w = [sample.robot.w for sample in samples if sample.part is DrivePart.SPRINT_W]
    return [max(v), -min(v), max(w), -min(w)]


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("rate", [10.0, 20.0, 30.0, 50.0, 100.0])
@pytest.mark.parametrize("acceleration", [0.2, 0.5, 0.9, 1.0, 2.0, 4.0])
def test_a_sprint_lasts_until_the_commanded_speed(
    acceleration: float, rate: float, noise: float
) -> None:
    speeds = greatest_speeds(probed(acceleration, rate, noise=noise))
    assert speeds == pytest.approx([0.7, 0.7, 1.5, 1.5], abs=0.02 + 4.0 * noise)


@pytest.mark.parametrize(("acceleration", "rate"), [(0.9, 30.0), (2.0, 50.0), (1.0, 100.0)])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_base_that_accelerates_gently_is_identified(
    acceleration: float, rate: float, noise: float
) -> None:
    estimate = identify(probed(acceleration, rate, noise=noise))
    check_plausible(estimate)
    assert estimate.limits.v == pytest.approx(0.7, abs=0.01)
    assert estimate.limits.a == pytest.approx(acceleration, rel=0.1)
    assert not estimate.driving.limited


def test_a_peak_at_the_end_of_the_space_is_no_limit() -> None:
    assert not identify(probed(0.1, 20.0)).driving.limited


def test_implausible_estimates_are_refused() -> None:
    rng = np.random.default_rng(0)
    for response, expected in (
        (lambda command: Command(2.0 * command.vx, command.w), "response of v: expected odometry"),
        (lambda command: Command(command.vx, -command.w), "response of w: expected odometry"),
        (lambda command: Command(command.vx * rng.random(), command.w), "response of v: expected"),
    ):
        with pytest.raises(DriveError, match=expected):
            check_plausible(identify(probed(2.0, 20.0, response=response)))
    with pytest.raises(DriveError, match=r"limits\.v: expected at least half .* give more --space"):
        check_plausible(identify(probed(0.1, 20.0, v=1.5)))


@pytest.mark.parametrize("bias", [(0.0, 0.045), (0.0, -0.06), (0.0, 0.1), (0.03, 0.0)])
def test_a_bias_of_odometry_is_named(bias: tuple[float, float]) -> None:
    words = rf"got v={bias[0]:.3f} m/s, w={bias[1]:.3f} rad/s; correct the bias"
    with pytest.raises(DriveError, match=words):
        probed(0.9, 30.0, bias=bias)


@pytest.mark.parametrize("bias", [(0.0, 0.02), (0.015, 0.0)])
def test_a_small_bias_does_not_end_a_sprint(bias: tuple[float, float]) -> None:
    estimate = identify(probed(0.9, 30.0, bias=bias))
    check_plausible(estimate)
    assert (estimate.limits.v, estimate.limits.w) == pytest.approx((0.7, 1.5), abs=0.03)


def test_samples_without_motion_are_refused() -> None:
    samples = [
        DriveSample(part, 0.1 * i, Command(1.0, 1.0), AT_REST)
        for part in DrivePart
        for i in range(20)
    ]
    with pytest.raises(DriveError, match="got 0 in all messages"):
        identify(samples)


@pytest.mark.parametrize(
    ("ahead", "back", "left", "right", "expected"),
    [
        (0.5, 0.3, 9.0, 9.0, r"response of v: .* got 0\.50 and 0\.30 m/s"),
        (0.5, 0.2, 9.0, 9.0, r"response of v: .* got 0\.50 and 0\.20 m/s"),
        (9.0, 9.0, 1.0, 0.6, r"response of w: .* got 1\.00 and 0\.60 rad/s"),
    ],
)
def test_different_speeds_in_both_directions_are_refused(
    ahead: float, back: float, left: float, right: float, expected: str
) -> None:
    def response(command: Command) -> Command:
        return Command(
            float(np.clip(command.vx, -back, ahead)), float(np.clip(command.w, -right, left))
        )

    samples = probed(0.9, 30.0, response=response)
    estimate = identify(samples)
    assert estimate.limits.v <= max(greatest_speeds(samples)[:2])
    with pytest.raises(DriveError, match=expected):
        check_plausible(estimate)


def test_an_acceleration_at_the_bound_of_the_fit_is_refused() -> None:
    estimate = identify(probed(0.9, 30.0))
    for name, words in (("gain", "gain of speed of v"), ("loss", "loss of speed of v")):
        response = dataclasses.replace(estimate.driving.response, **{name: 30.0})
        driving = dataclasses.replace(estimate.driving, response=response)
        with pytest.raises(DriveError, match=rf"{words}: expected less than 30 m/s\^2"):
            check_plausible(dataclasses.replace(estimate, driving=driving))


@pytest.mark.parametrize("point", [(0.2, 0.0), (-0.2, 0.0), (0.1, -0.15), (0.0, 0.0)])
def test_the_point_that_odometry_describes_is_found(point: tuple[float, float]) -> None:
    estimate = identify(probed(0.8, 20.0, point=point))
    assert estimate.point == pytest.approx(point, abs=0.01)
    words = f"odometry describes a point {point[0]:.2f} m ahead and {point[1]:.2f} m to the left"
    assert any(line.startswith(words) for line in report(estimate)) is (point != (0.0, 0.0))


def test_a_base_that_never_drives_backward_is_probed_forward_only() -> None:
    drive, robot, tick = ProbeDrive(v=0.7, w=1.5, space=3.0, backward=False), AT_REST, 0
    while (command := drive.command(0.05 * tick, robot)) is not None:
        assert command.vx >= 0.0
        moved = Pose(0.05 * command.vx, 0.0, 0.05 * command.w)
        robot, tick = RobotState(robot.pose.compose(moved), command.vx, command.w), tick + 1
    estimate = identify(drive.samples)
    check_plausible(estimate)
    assert estimate.point == pytest.approx((0.0, 0.0), abs=0.01)
    description = dataclasses.replace(
        PIONEER, limits=dataclasses.replace(PIONEER.limits, v_back=0.0)
    )
    assert described(description, estimate).limits.backward == 0.0


def test_a_base_that_refuses_to_drive_backward_names_the_setting() -> None:
    with pytest.raises(
        DriveError, match=r"never drives backward, set limits\.v_back: 0 in --robot"
    ):
        probed(1.0, 20.0, response=lambda command: Command(max(0.0, command.vx), command.w))
