"""Which point of the robot odometry describes: in turns, each moves in its own way."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ator_ros.geometry import FloatArray, Pose, wrap_angle

_STEP = 0.04  # s; least time of a step: two messages at 50 Hz, as the noise of a pose is constant
_LONGEST_STEP = 0.3  # s; in longer steps, messages are missing
_LEAST_TURN = 0.02  # rad; in smaller steps, 5 mm of noise count as 0.25 m
_LARGEST_TURN = 0.6  # rad; above it, messages are missing, or the pose was reset
_KEPT = 100  # greatest number of steps: 5 s of turning at 20 Hz
_LEAST_TURNED = 0.3  # rad that all steps must have: as far as a base turns until a fault ends it
_FEWEST = 6  # least number of steps, twice that of the unknowns
_LEAST_OFFSET = 0.06  # m; with 0.05 m drives arrive, with 0.1 m some do not
# standard errors by which an offset must differ from 0: of a base at half of the described
# acceleration it is up to 8
_SURE = 8.0
_NOISE = 0.001  # m; least standard deviation of a step: encoders resolve about as much
_ROUNDED = 0.05  # m; so that the sentence rarely changes
# least number of steps, and greatest share of the unexplained motion, of a suspicion after a fault:
# 0.2 m beside the axle leave 0.01 (turns on the spot) to 0.49 (arcs), wheels that are stuck 0.57
_FEWEST_SUSPECT = 3
_UNEXPLAINED = 0.5


class OdometryPoint:
    """Estimates where the point whose pose odometry gives lies, from the axle's middle.

    `reach` is the distance in m from the axle to the farthest point of the robot. `remark` is a
    sentence on odometry of another point than the axle's middle, else empty.

    While a base with two driven wheels turns by an angle, the middle of its axle moves along the
    mean heading, as commanded. A point d m ahead of it moves sideways by 2 d sin(angle / 2), too,
    and one l m to its left backward by 2 l sin(angle / 2). Both are fitted by least squares, beside
    the share and the delay with which the base follows its commands.
    """

    def __init__(self, reach: float) -> None:
        self._reach = reach
        self._begin: tuple[float, Pose] | None = None
        self._driven = 0.0
        self._commanded = 0.0  # m as commanded since then, m/s last
        # each: chord of the turn, m as commanded, change of command in m/s, m ahead, m to the left
        self._steps: deque[tuple[float, float, float, float, float]] = deque(maxlen=_KEPT)
        self._last = -math.inf  # s
        self.remark = ""

    def update(self, time: float, pose: Pose, commanded: float) -> None:
        """Process odometry of `time` (s), and the commanded speed in m/s."""
        elapsed = time - self._last
        self._last = time
        if self._begin is None or not 0.0 <= elapsed <= _LONGEST_STEP:
            self._restart(time, pose, commanded)
            return
        self._driven += commanded * elapsed
        since, before = self._begin
        if time - since < _STEP:
            return
        turned = wrap_angle(pose.yaw - before.yaw)
        if _LEAST_TURN <= abs(turned) <= _LARGEST_TURN:
            moved = before._replace(yaw=before.yaw + 0.5 * turned).relative(pose)
            chord = 2.0 * math.sin(0.5 * turned)
            change = commanded - self._commanded
            self._steps.append((chord, self._driven, change, moved.x, moved.y))
            self.remark = self._remark()
        self._restart(time, pose, commanded)

    def _restart(self, time: float, pose: Pose, commanded: float) -> None:
        self._begin = time, pose
        self._driven = 0.0
        self._commanded = commanded

    def suspicion(self) -> str:
        """Return the point that would explain why a base seems to drive otherwise; empty if none.

        A fault ends a goal before enough steps are known for `remark`.
        """
        if self.remark or len(self._steps) < _FEWEST_SUSPECT:
            return self.remark
        chords, driven, _, along, _ = np.array(self._steps).T
        off = along - driven
        left = -float(off @ chords) / float(chords @ chords)
        rest = float(np.linalg.norm(off + left * chords))
        is_possible = _LEAST_OFFSET <= abs(left) <= self._reach
        if not is_possible or rest > _UNEXPLAINED * float(np.linalg.norm(off)):
            return ""
        return f"or odometry describes a point {_beside(left)} (`calibrate` measures it)"

    def _remark(self) -> str:
        if len(self._steps) < _FEWEST:
            return ""
        chords, driven, changes, along, sideways = np.array(self._steps).T
        if np.abs(chords).sum() < _LEAST_TURNED:
            return ""
        ahead = _offset(np.transpose([chords]), sideways)
        left = _offset(np.transpose([-chords, driven, changes]), along)
        found = ([_before(ahead)] if ahead else []) + ([_beside(left)] if left else [])
        if not found:
            return ""
        return (
            f"odometry seems to describe a point {' and '.join(found)}, but drives need the pose "
            "of the axle's middle (`calibrate` measures it)"
        )


def _before(ahead: float) -> str:
    return f"about {_rounded(ahead):.2f} m {'ahead of' if ahead > 0.0 else 'behind'} the axle"


def _beside(left: float) -> str:
    side = "left" if left > 0.0 else "right"
    return f"about {_rounded(left):.2f} m to the {side} of the axle's middle"


def _rounded(offset: float) -> float:
    return _ROUNDED * round(abs(offset) / _ROUNDED)


def _offset(columns: FloatArray, moved: FloatArray) -> float:
    """Return the factor in m of the first of `columns` (n, k) that explains motions (n,) in m.

    0 if it is small or uncertain.
    """
    found, _, rank, _ = np.linalg.lstsq(columns, moved, rcond=1e-6)
    freedom = len(moved) - int(rank)
    noise = max(_NOISE, float(np.sqrt(((moved - columns @ found) ** 2).sum() / freedom)))
    error = noise * math.sqrt(float(np.linalg.pinv(columns.T @ columns, rcond=1e-9)[0, 0]))
    offset = float(found[0])
    return offset if abs(offset) > max(_LEAST_OFFSET, _SURE * error) else 0.0
