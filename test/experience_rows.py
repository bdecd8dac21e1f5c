"""Synthetic experience for tests: durations follow a simple law, without a simulator."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.bases.description import Robot
from ator_ros.bases.drive_parts import DriveParts, parts_of_drive
from ator_ros.bases.routes import routes_of
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.table import columns
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import train

_MODELS: dict[tuple[str, str], PerformanceModel] = {}


def synthetic_experience(action: str, *, episodes: int = 300, seed: int = 1) -> pd.DataFrame:
    """Return starts of episodes whose duration grows with distance and turn.

    Far ones fail more often.
    """
    rng = np.random.default_rng(seed)
    x, y, xg, yg = rng.uniform(-3, 3, (4, episodes))
    yaw, yawg = rng.uniform(-math.pi, math.pi, (2, episodes))
    turn = np.abs((np.arctan2(yg - y, xg - x) - yaw + np.pi) % (2 * np.pi) - np.pi)
    dist = np.hypot(xg - x, yg - y)
    duration = 0.5 + dist + 0.7 * turn
    frame = pd.DataFrame({
        "action": action, "episode": np.arange(episodes), "t": 0.0, "x": x, "y": y, "yaw": yaw,
        "v": 0.0,
        "w": 0.0, "vy": 0.0, "ball_x": np.nan, "ball_y": np.nan, "xg": xg, "yg": yg, "yawg": yawg,
        "speedg": 0.0,
        "hold": 0, "time_to_go": duration, "duration": duration,
        "success": rng.random(episodes) > 0.1 * dist, "reason": "made up",
        "position_error": 0.01 * dist, "nearer": math.nan, "heading_error": 0.02,
        **DriveParts()._asdict(),
    })  # fmt: skip
    return frame[list(columns(SOCCER.objects))]


def synthetic_model(action: str, robot: Robot) -> PerformanceModel:
    """Return a model learned from synthetic experience, with the shipped candidate features."""
    key = action, robot.digest()
    if key not in _MODELS:
        rows = synthetic_experience(action)
        _MODELS[key] = train(action, rows, robot, features=SOCCER.candidates(action))
    return _MODELS[key]


def uncertain(model: PerformanceModel) -> PerformanceModel:
    """Return the same model with errors that make every gain uncertain."""
    assert model.errors is not None
    return dataclasses.replace(
        model, errors=dataclasses.replace(model.errors, signal=1e3, noise=1e6)
    )


def dead_zone_time(direct: Mapping[str, Any]) -> Any:
    """Return durations (s) of drives of a server that rotates to the path beyond 45 degrees."""
    dx, dy = direct["xg"] - direct["x"], direct["yg"] - direct["y"]
    path = np.arctan2(dy, dx)
    to, at = np.abs(wrap_angles(path - direct["yaw"])), np.abs(wrap_angles(direct["yawg"] - path))
    return (
        1.3
        + np.hypot(dx, dy) / 0.6
        + np.maximum(0, to - math.pi / 4) / 0.7
        + np.maximum(0, at - 0.15) / 1.05
    )


def dead_zone_drives(count: int, *, seed: int, noise: float = 0.12) -> pd.DataFrame:
    """Return drives from rest that take `dead_zone_time`, with noise (s)."""
    rows = synthetic_experience("drive_to", episodes=count, seed=seed)
    duration = dead_zone_time(rows) + np.random.default_rng(seed).normal(0.0, noise, count)
    return rows.assign(time_to_go=duration, duration=duration, success=True)


def whole_drives(
    count: int, *, seed: int, noise: float, backward_above: float = math.pi
) -> tuple[pd.DataFrame, FloatArray]:
    """Return drives at 10 Hz with noise (s) on straights, and durations (s) without it, shape (n,).

    Turns take as long as in `dead_zone_time`. Above an angle (rad) straights are backward, at 0.4
    m/s.
    """
    starts = dead_zone_drives(count, seed=seed, noise=0.0)
    dx, dy = starts["xg"] - starts["x"], starts["yg"] - starts["y"]
    path = np.arctan2(dy, dx)
    backward = np.abs(wrap_angles(path - starts["yaw"])) > backward_above
    heading = path + math.pi * backward
    to, at = (
        np.abs(wrap_angles(heading - starts["yaw"])),
        np.abs(wrap_angles(starts["yawg"] - heading)),
    )
    first = 0.5 + np.maximum(0.0, to - math.pi / 4) / 0.7
    straight = np.hypot(dx, dy) / np.where(backward, 0.4, 0.6)
    last = 0.8 + np.maximum(0.0, at - 0.15) / 1.05
    driven = np.maximum(straight + np.random.default_rng(seed).normal(0.0, noise, count), 0.1)
    drives = []
    for index, duration in enumerate(first + driven + last):
        t = np.arange(0.0, duration, 0.1)
        share = np.clip((t - first[index]) / driven[index], 0.0, 1.0)
        v = np.where((share > 0.0) & (share < 1.0), -0.4 if backward[index] else 0.6, 0.0)
        parts = parts_of_drive(t, v, duration)._asdict()
        drives.append(
            starts.iloc[[index] * len(t)].assign(
                t=t, x=starts["x"][index] + share * dx[index],
                y=starts["y"][index] + share * dy[index],
                v=v, time_to_go=duration - t, duration=duration, **parts,
            )
        )  # fmt: skip
    return pd.concat(drives, ignore_index=True), (first + straight + last).to_numpy()


def route_drives(robot: Robot, count: int, *, seed: int, noise: float = 0.0) -> pd.DataFrame:
    """Return drives from rest in the hall with a wall; their durations follow from their routes."""
    rows, routes = dead_zone_drives(count, seed=seed), routes_of(robot)
    assert routes is not None
    rows = rows[(rows["x"].abs() > 0.7) & (rows["xg"].abs() > 0.7)].reset_index(drop=True)
    route = routes.between(*(rows[name].to_numpy() for name in ("x", "y", "xg", "yg")))
    to = np.abs(wrap_angles(route.departure - rows["yaw"]))
    at = np.abs(wrap_angles(rows["yawg"] - route.arrival))
    duration = 1.0 + route.length / 0.6 + 0.5 * route.turn + np.maximum(0.0, to - 0.8) + 0.9 * at
    duration += np.random.default_rng(seed).normal(0.0, noise, len(rows))
    return rows.assign(time_to_go=duration, duration=duration)
