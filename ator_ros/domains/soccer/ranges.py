"""The ranges of goal variables in soccer: speeds that were learned."""

from __future__ import annotations

import functools
from types import MappingProxyType

from ator_ros.tops.ranges import USUAL_RANGES, Ranges, arrival_speed

ARRIVAL_SPEED = 0.8
"""Greatest arrival speed in m/s that is searched, and that situations to learn from are drawn with."""

RANGES: Ranges = MappingProxyType(
    {**USUAL_RANGES, "speed": functools.partial(arrival_speed, most=ARRIVAL_SPEED)}
)
