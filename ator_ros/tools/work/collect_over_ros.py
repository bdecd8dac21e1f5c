"""Experience of remote actions: drives over ROS, each a chain of one step, from the executor's records."""

from __future__ import annotations

import argparse
from collections.abc import Container, Iterator

import pandas as pd

from ator_ros.actions.situation import Situation
from ator_ros.domains.domain import Domain
from ator_ros.experience.collect import episode_generator
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.records import ENDED, episode_of
from ator_ros.experience.table import episode_frame
from ator_ros.nodes.messages import chain_of
from ator_ros.robot.description import Robot
from ator_ros.tools.processes import all_nodes, node_setting
from ator_ros.tools.work.demo_client import DemoClient
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.outcome import top_of
from ator_ros.world.messages import MessageError
from ator_ros.world.state import World

_FRAME = "odom"
_TRIES = 3


def drives(
    options: argparse.Namespace, domain: Domain, robot: Robot, finished: Container[tuple[str, int]]
) -> Iterator[pd.DataFrame]:
    """Yield a row for each drive that is not finished, in the order of actions and episodes.

    The situations are those that `collect` draws without ROS from the same seed.
    """
    wanted = [(action, number) for action in options.actions for number in range(options.episodes)]
    missing = [key for key in wanted if key not in finished]
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
            yield _driven(client, options, domain, robot, situation, number)


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
            if record.outcome.code in ENDED:
                try:
                    return episode_frame(number, episode_of(record, domain, robot), domain.objects)
                except MessageError as error:
                    reason = str(error)
    raise ExperienceError(
        f"{situation.action}, drive {number + 1}: expected a drive that ends by itself in {_TRIES} tries, "
        f"the last one ended with {reason!r}"
    )
