"""The response of one axis of a base (driving or turning) to velocity commands: latency, ramp, lag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.robot.ramp import clip


@dataclass(frozen=True, slots=True)
class AxisResponse:
    """How one axis follows commands.

    A command takes effect `latency` after the stamp of the state that it answers. The set speed is clipped to
    `limit` and changes by at most `gain`, `loss` or, toward a command to stand, `stop` per second. The
    measured speed follows the set speed with a first-order lag.

    Attributes
    ----------
    latency, lag : float
        In s.
    limit : float
        Greatest speed in m/s or rad/s.
    gain, loss, stop : float
        Rates of change in m/s^2 or rad/s^2.
    """

    latency: float
    lag: float
    limit: float
    gain: float
    loss: float
    stop: float

    def speeds(self, times: Sequence[float], commands: Sequence[float]) -> FloatArray:
        """Return the speeds at `times` of an axis that stood at the first of them.

        Parameters
        ----------
        times : sequence of float, length n
            Stamps of the states in s, ascending.
        commands : sequence of float, length n
            The command sent in answer to each state, in m/s or rad/s.

        Returns
        -------
        ndarray, shape (n,)
        """
        found = np.zeros(len(times))
        state, now, command, following = (0.0, 0.0), times[0], 0.0, 0
        for number, time in enumerate(times):
            while following < number and times[following] + self.latency < time:
                acts = max(now, times[following] + self.latency)
                state, now = self._after(state, command, acts - now), acts
                command, following = clip(commands[following], self.limit), following + 1
            state, now = self._after(state, command, time - now), time
            found[number] = state[1]
        return found

    def _after(self, state: tuple[float, float], command: float, seconds: float) -> tuple[float, float]:
        """Return set and measured speed after `seconds` under one command, in closed form."""
        setpoint, speed = state
        while seconds > 0.0:
            reversing = setpoint * command < 0.0
            aim = 0.0 if reversing else command
            if command == 0.0:
                rate = self.stop
            else:
                rate = self.loss if reversing or abs(command) < abs(setpoint) else self.gain
            span = min(seconds, abs(aim - setpoint) / rate) if aim != setpoint else seconds
            slope = math.copysign(rate, aim - setpoint) if aim != setpoint else 0.0
            behind = slope * self.lag
            new = setpoint + slope * span if span < abs(aim - setpoint) / rate else aim
            speed = new - behind + (speed - setpoint + behind) * math.exp(-span / self.lag)
            setpoint, seconds = new, seconds - span
        return setpoint, speed
