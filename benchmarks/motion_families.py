"""How near a robot's kinds of ideal motions come to all combinations of a fine grid, for some robots.

Beside the few kinds of the shipped models stand those that `train` chooses for a robot. Both are measured on
motions that they were not chosen with.
    scripts/run python benchmarks/motion_families.py --seed 2045 --out docs/motion_families.json
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ator_ros.domains.soccer.chosen_motions import (
    APPROACH,
    DRIBBLE,
    DRIVE,
    chosen_dribbles,
    chosen_drives,
    free_grid,
    pushed_grid,
    turns_of,
)
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.families import PushedTurns, approach_family, dribble_family, drive_family
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.geometry import FloatArray
from ator_ros.motion.families import Family, FreeTurns, drawn_ends, times_of
from ator_ros.robot.description import Robot

FORMAT = Format("ator_ros motion families", 2, "comparison of motion families")
ROBOTS = tuple(
    Path(folder, f"{name}.yaml")
    for folder, name in (
        ("config", "pioneer"), ("config", "turtlebot4"), ("config", "pioneer_lx"), ("config", "patrolbot"),
        ("test", "fifth"),
    )
)  # fmt: skip


@dataclass(frozen=True)
class FamilyRow:
    """Mean excess in percent over the least times of the whole grid, of few kinds and of the chosen ones.

    `least_s` is the mean of the least times in s. `late_percent` is the share of motions that take more than
    a tenth longer with the chosen kinds.
    """

    robot: str
    family: str
    grid: int
    least_s: float
    few: int
    few_percent: float
    chosen: int
    chosen_percent: float
    late_percent: float


def families_of(robot: Robot) -> Iterator[tuple[str, Family, Family, Family]]:
    """Yield the families by name: of few kinds, of the chosen ones, of the whole grid."""
    limits, drives = robot.limits, chosen_drives(robot)
    drive = turns_of(drives, DRIVE, FreeTurns)
    yield DRIVE, drive_family(limits), drive_family(limits, drive), drive_family(limits, free_grid((0.0,)))
    if robot.holder is not None:
        approach = approach_family(robot, turns_of(drives, APPROACH, FreeTurns))
        yield APPROACH, approach_family(robot), approach, approach_family(robot, free_grid())
        dribble = dribble_family(robot, turns_of(chosen_dribbles(robot), DRIBBLE, PushedTurns))
        yield DRIBBLE, dribble_family(robot), dribble, dribble_family(robot, pushed_grid(robot))


def compared(robot: Robot, count: int, seed: int) -> Iterator[FamilyRow]:
    """Yield the comparison of each family of a robot, in `count` motions."""
    for name, few, chosen, grid in families_of(robot):
        ends = drawn_ends(grid.limits, count, np.random.default_rng(seed))
        of_few, of_chosen, least = (_times(family, ends, robot) for family in (few, chosen, grid))
        yield FamilyRow(
            robot.name, name, len(grid.kinds), round(float(least.mean()), 3),
            len(few.kinds), _percent(of_few.mean() / least.mean() - 1.0),
            len(chosen.kinds), _percent(of_chosen.mean() / least.mean() - 1.0),
            _percent(np.mean(of_chosen > 1.1 * least)),
        )  # fmt: skip


def _times(family: Family, ends: FloatArray, robot: Robot) -> FloatArray:
    """Return the time in s of the fastest kind, or what a model takes where none leads to the destination."""
    return np.minimum(times_of(family, ends, robot.hold).min(axis=0), family.missed[0])


def _percent(share: float) -> float:
    return round(100.0 * float(share), 3)


def rows_of(robots: Sequence[Path], count: int, seed: int) -> Iterator[FamilyRow]:
    """Yield the comparison of each family of each robot."""
    for file in robots:
        yield from compared(SOCCER.robot(file), count, seed)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", nargs="+", type=Path, default=ROBOTS, metavar="FILE")
    parser.add_argument("--situations", type=int, default=2000, help="to measure on")
    parser.add_argument("--seed", type=int, default=2045)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.json")
    words = list(sys.argv[1:] if argv is None else argv)
    options = parser.parse_args(words)
    rows = []
    numbers = ("grid", "least s", "few", "%", "chosen", "%", "late %")
    print(f"{'robot':14}{'family':10}" + "".join(f"{name:>8}" for name in numbers))
    for row in rows_of(options.robots, options.situations, options.seed):
        rows.append(dataclasses.asdict(row))
        print(
            f"{row.robot:14}{row.family:10}{row.grid:8}{row.least_s:8.2f}{row.few:8}{row.few_percent:8.2f}"
            f"{row.chosen:8}{row.chosen_percent:8.2f}{row.late_percent:8.2f}",
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
