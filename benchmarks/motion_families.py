"""How near the kinds of ideal motions that ship come to all combinations of a fine grid, for some robots.

Beside them stands a choice of as many kinds from the grid, made one by one: each is the one that brings the
times nearest to those of the whole grid. It is made on other situations than it is measured on.
    scripts/run python benchmarks/motion_families.py --seed 2045 --out docs/motion_families.json
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.families import (
    PushedTurns,
    approach_family,
    dribble_family,
    pushed_kinds,
    shot_family,
)
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.release import usual_release
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.families import Family, FreeTurns, Kind, drive_family, free_kinds
from ator_ros.motion.motion_search import search_fastest
from ator_ros.robot.description import Robot

FORMAT = Format("ator_ros motion families", 1, "comparison of motion families")
ROBOTS = tuple(
    Path("config", f"{name}.yaml") for name in ("pioneer", "turtlebot4", "pioneer_lx", "patrolbot")
)
_FREE = (-1.0, -0.6, -0.25, 0.0, 0.25, 0.6, 1.0)
_RUNS = (0.0, 0.35, 0.8, 1.0)
_ENTRIES, _GAINS = (np.nan, 0.1, 0.2, 0.55), (0.0, 0.25, 0.5, 0.75, 0.96)
_LOSSES, _AFTER = (0.0, 0.5, 0.9), (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.75, 0.95)
_AIMS, _SLANTS = (-0.2, 0.0, 0.2), (-0.6, 0.0, 0.6)
"""Shares of the goal's width and directions in rad of the fixed shots that are features."""
_LATE = 3.0
"""How many times the least time counts where no chosen kind leads to the destination."""


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


def _free_grid(family: Family, runs: Iterable[float] = (0.0,)) -> tuple[Kind, ...]:
    rows = (FreeTurns(*row) for row in itertools.product(_FREE, _FREE, (False, True), runs))
    return free_kinds(family.limits, rows)


def _pushed_grid(robot: Robot) -> tuple[Kind, ...]:
    return pushed_kinds(
        robot, (PushedTurns(*row) for row in itertools.product(_ENTRIES, _GAINS, _LOSSES, _AFTER))
    )


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
        return _free_grid(SHIPPED[name](robot))
    return _free_grid(SHIPPED[name](robot), _RUNS) if name == "approach" else _pushed_grid(robot)


def drawn_ends(robot: Robot, name: str, count: int, rng: np.random.Generator) -> FloatArray:
    """Return ends of motions, (5, m, count), as `fastest_motions` takes them."""
    if name == "shot":
        return np.stack([_shots(robot, rng) for _ in range(count)], axis=2)
    # On the field; half of them begin, and half of them end, at half the greatest speed.
    x, y, turn = (rng.uniform(-most, most, count) for most in (4.0, 3.0, np.pi))
    speeds = 0.5 * SHIPPED[name](robot).limits.v * rng.integers(0, 2, (2, count))
    return np.stack((x, y, turn, *speeds))[:, None]


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


def times_of(family: Family, ends: FloatArray, hold: float) -> FloatArray:
    """Return the time in s of each kind in each situation, (kinds, n); infinite where it leads elsewhere."""
    times = np.empty((len(family.kinds), ends.shape[2]))
    for kind in range(len(family.kinds)):
        result = np.empty((2, ends.shape[2]))
        row = family.rows[kind : kind + 1]
        search_fastest(ends, row, family.tables, family.rules(hold), (np.inf, 0.0), result, 0, ends.shape[2])
        times[kind] = result[0]
    return times


def chosen(times: FloatArray, count: int) -> list[int]:
    """Choose `count` kinds by the times of each, (kinds, n): the one that saves the most time is next."""
    least = times.min(axis=0)
    reached = np.isfinite(least)
    so_far, picked = _LATE * least[reached], list[int]()
    for _ in range(count):
        sums = np.minimum(so_far, times[:, reached]).sum(axis=1)
        picked.append(int(np.argmin(sums)))
        so_far = np.minimum(so_far, times[picked[-1], reached])
    return picked


def compared(robot: Robot, name: str, count: int, seed: int) -> FamilyRow:
    """Compare a family with a choice of as many kinds of its grid."""
    family, grid = SHIPPED[name](robot), grid_of(name, robot)
    both = dataclasses.replace(family, kinds=(*family.kinds, *grid))
    rng = np.random.default_rng(seed)
    to_choose, to_measure = (
        times_of(both, drawn_ends(robot, name, count, rng), robot.hold) for _ in range(2)
    )
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
