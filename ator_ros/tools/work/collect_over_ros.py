"""Experience of remote actions: drives over ROS, each a chain of one step, from the executor's records."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.actions.situation import Situation
from ator_ros.domains.domain import Domain
from ator_ros.experience.collect import episode_generator
from ator_ros.experience.columns import columns
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.records import ENDED, episode_of, sound
from ator_ros.experience.table import episode_frame
from ator_ros.files import UnreadableError, read_text, write_text
from ator_ros.nodes.conversions import chain_of
from ator_ros.printable import short
from ator_ros.robot.description import Robot
from ator_ros.tools.processes import all_nodes, node_setting
from ator_ros.tools.work.demo_client import DemoClient
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.outcome import top_of
from ator_ros.world.state import World

_FRAME = "odom"
_TRIES = 3
_LARGEST = 100_000_000


class Finished:
    """The drives that are finished, kept one by one beside the table, so that a collection can resume.

    Parameters
    ----------
    table : Path
        The table to be.
    identity : mapping
        What the drives depend on; a collection with other settings is not resumed.

    Raises
    ------
    ExperienceError
        The file holds drives of other settings, or cannot be read.
    """

    def __init__(self, table: Path, identity: dict[str, Any]) -> None:
        self.path = _beside(table)
        head = json.dumps(identity, sort_keys=True)
        self.rows: dict[tuple[str, int], dict[str, Any]] = {}
        lines = [head]
        if self.path.exists():
            try:
                lines = read_text(self.path, _LARGEST).split("\n")[:-1]  # one that was cut off is forgotten
                found = [_row_in(line) for line in lines[1:]]
            except (OSError, ValueError, UnreadableError) as error:
                raise ExperienceError(f"{self.path}: expected drives, one a line: {error}") from error
            if lines[:1] != [head]:
                raise ExperienceError(
                    f"{self.path}: expected drives of the same seed, robot and domain, got others: choose "
                    "another --out, or delete that file"
                )
            self.rows = {(row["action"], row["episode"]): row for row in found}
        write_text(self.path, "\n".join([*lines, ""]))

    def add(self, frame: pd.DataFrame) -> None:
        """Keep the row of one more drive."""
        row = frame.iloc[0].to_dict()
        plain = {name: value.item() if hasattr(value, "item") else value for name, value in row.items()}
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(plain) + "\n")
        self.rows[plain["action"], plain["episode"]] = plain

    @staticmethod
    def remove(table: Path) -> None:
        """Delete the drives of a table, once that is written."""
        _beside(table).unlink(missing_ok=True)


def _beside(table: Path) -> Path:
    """Return the file of the drives of a table to be."""
    return table.with_suffix(".drives.jsonl")


def _row_in(line: str) -> dict[str, Any]:
    """Return the row of a table that a line holds; raises ValueError where it holds something else."""
    row = json.loads(line)
    if not isinstance(row, dict) or (missing := sorted(columns(()).keys() - row.keys())):
        raise ValueError(f"{short(line)} {f'lacks {missing}' if isinstance(row, dict) else 'is no row'}")
    if not (isinstance(row["action"], str) and type(row["episode"]) is int):
        raise ValueError(f"{short(line)}: expected a name as action and a whole number as episode")
    return row


def drives(
    options: argparse.Namespace, domain: Domain, robot: Robot, finished: Finished
) -> Iterator[pd.DataFrame]:
    """Yield a row for each drive, in the order of actions and episodes; drives that are finished come first.

    The situations are those that `collect` draws without ROS from the same seed.
    """
    wanted = [(action, number) for action in options.actions for number in range(options.episodes)]
    names = columns(domain.objects, domain.goal_variables)
    for key in wanted:
        if key in finished.rows:
            row = finished.rows[key]
            yield pd.DataFrame([{name: row[name] for name in names if name in row}])
    missing = [key for key in wanted if key not in finished.rows]
    if not missing:
        return
    with (
        all_nodes(options.real_time_factor, **node_setting(options)) as nodes,
        DemoClient(nodes.domain, nodes.check, domain.objects) as client,
    ):
        client.ready(domain.remote_servers(options.action_set), len(domain.programs))
        for action, number in missing:
            rng = episode_generator(action, options.seed, number)
            situation = domain.actions(options.action_set)[action].sample(robot, rng)
            frame = _driven(client, options, domain, robot, situation, number)
            finished.add(frame)
            yield frame


def _driven(
    client: DemoClient,
    options: argparse.Namespace,
    domain: Domain,
    robot: Robot,
    situation: Situation,
    number: int,
) -> pd.DataFrame:
    """Drive from a situation to its goal; return the row of the executor's record."""
    top = top_of(situation, domain.tops_for(robot), robot)
    start = World(0.0, situation.robot, situation.objects)
    message = chain_of(TopChain((TopCall(top, situation.goal),)), action_set=options.action_set, frame=_FRAME)
    reason = ""
    for _ in range(_TRIES):  # what another program or a busy machine broke off teaches nothing
        client.place(start)
        for record in client.record_of(message, refine=False).actions:
            reason = record.outcome.reason
            if record.outcome.code in ENDED and sound(episode := episode_of(record, domain)):
                return episode_frame(number, episode, domain.objects)
    raise ExperienceError(
        f"{situation.action}, drive {number + 1}: expected a drive that ends by itself in {_TRIES} tries, "
        f"the last one ended with {reason!r}"
    )
