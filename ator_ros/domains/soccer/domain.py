"""Soccer as a domain."""

from __future__ import annotations

from ator_ros.domains.domain import Domain
from ator_ros.domains.soccer.actions import ACTION_SETS
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.chains import CHAINS
from ator_ros.domains.soccer.features import MOTIONS, SHOT
from ator_ros.domains.soccer.field import field_in, field_lines
from ator_ros.domains.soccer.ranges import RANGES
from ator_ros.domains.soccer.tops import TOPS, tops_for
from ator_ros.domains.soccer.wanted import goals

SOCCER = Domain(
    "soccer",
    TOPS,
    ACTION_SETS,
    (BALL,),
    CHAINS,
    variables=RANGES,
    bays=field_in,
    features=(*MOTIONS, *SHOT),
    lines=field_lines,
    goals=goals,
    fitted=tops_for,
)
