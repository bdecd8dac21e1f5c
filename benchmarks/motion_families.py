"""How near a robot's kinds of ideal motions come to all combinations of a fine grid, for some robots.

Beside them stands a choice of as many kinds from the grid, made as `ator_ros.motion.choosing` makes it, in
other situations than those that it is measured in.
    scripts/run python benchmarks/motion_families.py --seed 2045 --out docs/motion_families.json
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.families import (
    RUNS,
    approach_family,
    dribble_family,
    drive_family,
    free_grid,
    pushed_grid,
    pushed_kinds,
    shot_family,
)
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.release import usual_release
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.choosing import chosen, drawn_ends, times_of
from ator_ros.motion.families import Family, Kind, free_kinds
from ator_ros.robot.description import Robot

FORMAT = Format("ator_ros motion families", 1, "comparison of motion families")
ROBOTS = tuple(
    Path("config", f"{name}.yaml") for name in ("pioneer", "turtlebot4", "pioneer_lx", "patrolbot")
)
_AIMS, _SLANTS = (-0.2, 0.0, 0.2), (-0.6, 0.0, 0.6)
"""Shares of the goal's width and directions in rad of the fixed shots that are features."""
_LATE = 3.0
"""How many times the least time counts where no kind leads to the destination."""


@dataclass(frozen=True)
class FamilyRow:
    """Mean excess in percent over the least times of grid and shipped kinds, of as many kinds each.

    `least_s` is the mean of the least times in s.
    """

    robot: str
    family: str
    kinds: int
    grid: int
    least_s: float
    shipped_percent: float
    chosen_percent: float


SHIPPED: Mapping[str, Callable[[Robot], Family]] = MappingProxyType(
    {
        "drive": lambda robot: drive_family(robot.limits),
        "approach": approach_family,
        "dribble": dribble_family,
        "shot": shot_family,
    }
)
"""The families, by what they are for; a robot without a holder has the first only."""


def grid_of(name: str, robot: Robot) -> tuple[Kind, ...]:
    """Return all kinds to choose from for one of the SHIPPED families."""
    if name == "drive":
        return free_kinds(robot.limits, free_grid((0.0,)))
    return (
        free_kinds(robot.limits, free_grid(RUNS))
        if name == "approach"
        else pushed_kinds(robot, pushed_grid())
    )


def ends_for(robot: Robot, name: str, count: int, rng: np.random.Generator) -> FloatArray:
    """Return ends of motions, (5, m, count), as `fastest_motions` takes them."""
    if name == "shot":
        return np.stack([_shots(robot, rng) for _ in range(count)], axis=2)
    return drawn_ends(SHIPPED[name](robot).limits, count, rng)


def _shots(robot: Robot, rng: np.random.Generator) -> FloatArray:
    """Return the ends of the fixed shots from where an episode of shoot may start, (5, shots)."""
    start = situations.shoot(robot, rng)
    (x, y, _), width = start.goal.pose, field_of(robot).goal_width
    back, fastest = usual_release(robot) + robot.hold, robot.holder_for("a shot").limits.v
    ends = []
    for aim, slant in itertools.product(_AIMS, _SLANTS):
        release = Pose(x - back * math.cos(slant), y + width * aim - back * math.sin(slant), slant)
        ends.append((*start.robot.pose.relative(release), start.robot.v, fastest))
    return np.array(ends).T


def compared(robot: Robot, name: str, count: int, seed: int) -> FamilyRow:
    """Compare a family with a choice of as many kinds of its grid."""
    family, grid = SHIPPED[name](robot), grid_of(name, robot)
    both = dataclasses.replace(family, kinds=(*family.kinds, *grid))
    rng = np.random.default_rng(seed)
    to_choose, to_measure = (times_of(both, ends_for(robot, name, count, rng), robot.hold) for _ in range(2))
    own = len(family.kinds)
    picked = [own + kind for kind in chosen(to_choose[own:], own)]
    least = to_measure.min(axis=0)
    reached = np.isfinite(least)

    def excess(kinds: Sequence[int]) -> float:
        times = np.minimum(to_measure[list(kinds)].min(axis=0), _LATE * least)[reached]
        return round(100.0 * float(times.mean() / least[reached].mean() - 1.0), 3)

    return FamilyRow(
        robot.name, name, own, len(grid), round(float(least[reached].mean()), 3),
        excess(range(own)), excess(picked),
    )  # fmt: skip


def rows_of(robots: Sequence[Path], count: int, seed: int) -> Iterator[FamilyRow]:
    """Yield the comparison of each family of each robot."""
    for file in robots:
        robot = SOCCER.robot(file)
        names = SHIPPED if robot.holder is not None else ("drive",)
        yield from (compared(robot, name, count, seed) for name in names)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", nargs="+", type=Path, default=ROBOTS, metavar="FILE")
    parser.add_argument("--situations", type=int, default=600, help="to choose on, and as many to measure on")
    parser.add_argument("--seed", type=int, default=2045)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.json")
    words = list(sys.argv[1:] if argv is None else argv)
    options = parser.parse_args(words)
    rows = []
    print(f"{'robot':14}{'family':10}{'kinds':>6}{'grid':>6}{'least s':>9}{'shipped %':>11}{'chosen %':>10}")
    for row in rows_of(options.robots, options.situations, options.seed):
        rows.append(dataclasses.asdict(row))
        print(
            f"{row.robot:14}{row.family:10}{row.kinds:6}{row.grid:6}{row.least_s:9.3f}"
            f"{row.shipped_percent:11.2f}{row.chosen_percent:10.2f}",
            flush=True,
        )
    settings = {
        "command": portable_command("motion_families", words),
        "seed": options.seed,
    }
    write_text(options.out, FORMAT.text({**settings, "situations": options.situations, "rows": rows}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
