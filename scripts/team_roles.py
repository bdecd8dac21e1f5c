"""Who goes to the ball: by predicted time, by distance, and while the robots drive.

    scripts/run python scripts/team_roles.py standing --robots 2 --situations 500
    scripts/run python scripts/team_roles.py standing --mate config/pioneer_lx.yaml --mate-models M
    scripts/run python scripts/team_roles.py driving --robots 2 --episodes 8
    scripts/run python scripts/team_roles.py noise --episodes 3

`standing`: each robot fetches the ball alone in the simulator; which one should have gone?
`driving` and `noise`: robots in one simulation fetch a ball that is put elsewhere whenever one has
it. Each robot decides five times a second, with its own messages, as the node `team` does.
"""

from __future__ import annotations

import itertools
import math
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ator_ros.actions.base import Status
from ator_ros.domains.soccer.field import BALL
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.execution.chain_executor import ChainExecutor, Ending
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.accuracy import mean_ci95
from ator_ros.refinement.gate import NO_GATE, Gate
from ator_ros.simulation.scene_simulation import TICK, Simulation
from ator_ros.team.role_file import Role, RoleStep
from ator_ros.team.roles import (
    Course,
    Member,
    Plan,
    bids_of,
    common_objects,
    course_in,
    plan_roles,
)
from ator_ros.team.roster import PERIOD, Roster
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, ObjectState, RobotState, World

TOOLS, LIBRARY = tools_of(ToolsetSource())
ROBOT = LIBRARY.robot
ROLES = (
    Role("ball", (RoleStep("goToBall", at=BALL, open=("yaw",)),), weight=10.0),
    Role(
        "support",
        (RoleStep("goToPose", at=BALL, x=-1.0, y=1.2, open=("yaw",)),),
        ((RoleStep("goToPose", at=BALL, x=-1.0, y=-1.2, open=("yaw",)),),),
    ),
    Role("keeper", (RoleStep("goToPose", x=-3.0),)),
)
NAMES = ("ann", "bob", "eve")
SPACING = 0.8  # m, least distance of robots and ball from each other and from the edges
TIMEOUT = 1.0  # s, as that of the node
DELAY = 0.05  # s from a message to its arrival
PERSISTENCE = 1.0  # s, time constant of the errors of positions
PER_METER, PER_RADIAN = 7.0, 3.82
"""s per m and per rad of Bit-Bots, bitbots_behavior/bitbots_body_behavior/config/body_behavior.yaml
at 08c4c578: time_to_ball_cost_per_meter and time_to_ball_cost_start_angle."""


def places(rng: np.random.Generator, count: int) -> FloatArray:
    """Draw places in the area that keep their distance, shape (count, 2)."""
    area = ROBOT.scene.area
    half = np.array([area.length, area.width]) / 2.0 - SPACING
    while True:
        found = rng.uniform(-half, half, (count, 2))
        if all(math.dist(*pair) > SPACING for pair in itertools.combinations(found, 2)):
            return found


def interval(values: Sequence[float], digits: int = 2) -> str:
    """Return a mean and its 95 % interval."""
    low, high = mean_ci95(np.array(values, dtype=float))
    return f"{np.mean(values):.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


# Standing


def turn_to(pose: Pose, ball: ObjectState) -> float:
    """Return the angle in rad between the robot's heading and the direction of the ball."""
    bearing = math.atan2(ball.y - pose.y, ball.x - pose.x)
    return abs(math.remainder(bearing - pose.yaw, math.tau))


def linear_cost(pose: Pose, ball: ObjectState, per_meter: float, per_radian: float) -> float:
    """Return a sum of distance and angle."""
    distance = math.hypot(ball.x - pose.x, ball.y - pose.y)
    return per_meter * distance + per_radian * turn_to(pose, ball)


FORMULAS: dict[str, Callable[[Pose, ObjectState], float]] = {
    "distance": partial(linear_cost, per_meter=1.0, per_radian=0.0),
    "distance and angle, weights of Bit-Bots": partial(
        linear_cost, per_meter=PER_METER, per_radian=PER_RADIAN
    ),
    "distance and angle, this robot's limits": partial(
        linear_cost,
        per_meter=1.0 / ROBOT.greatest_speed(),
        per_radian=1.0 / ROBOT.greatest_turn_rate,
    ),
}


Make = tuple[Toolset, TopLibrary]
"""The models of a robot, and its library."""


def standing(makes: Sequence[Make], situations: int, seed: int) -> None:
    """Print which robot is chosen, and how much later it is at the ball than the fastest one.

    With robots of different `makes`, times are also predicted by the first one's models for all.
    """
    own, every = "predicted time", "predicted time, the first one's models for all"
    names = [own, every, *FORMULAS] if len(set(map(id, makes))) > 1 else [own, *FORMULAS]
    chosen: dict[str, list[int]] = {name: [] for name in names}
    times = []
    for number in range(situations):
        rng = np.random.default_rng([seed, len(makes), number])
        *starts, there = places(rng, len(makes) + 1)
        ball = ObjectState(*there)
        poses = [Pose(x, y, rng.uniform(-math.pi, math.pi)) for x, y in starts]
        worlds = [World(0.0, RobotState(pose), {BALL: ball}) for pose in poses]
        found = [fetching(*each) for each in zip(worlds, makes, strict=True)]
        durations = []
        for world, (tools, library), (_, chain) in zip(worlds, makes, found, strict=True):
            run = run_chain(tools.robot, library, world, chain)
            durations.append(run.duration if run.success else math.nan)
        if not np.isfinite(durations).all():
            continue
        times.append(durations)
        costs = {name: [cost(pose, ball) for pose in poses] for name, cost in FORMULAS.items()}
        costs[own] = [cost for cost, _ in found]
        costs[every] = [fetching(world, makes[0])[0] for world in worlds]
        for name, numbers in chosen.items():
            numbers.append(int(np.argmin(costs[name])))
    table = np.array(times)
    print(
        f"{len(makes)} robots, {len(table)} of {situations} situations in which all reach the ball"
    )
    print("| chosen by | the fastest one (%) | later than it (s) |\n| --- | --- | --- |")
    for name, robot in chosen.items():
        loss = table[np.arange(len(table)), robot] - table.min(axis=1)
        print(f"| {name} | {interval(100.0 * (loss < TICK / 2), 1)} | {interval(loss, 3)} |")


def fetching(world: World, make: Make) -> tuple[float, TopChain]:
    """Return the predicted cost of fetching the ball by a robot of this make, and its chain."""
    tools, library = make
    (plan,) = plan_roles(world, ROLES[:1], tools.refiner(), library, world.objects).values()
    if plan.chain is None or plan.bid is None:
        raise SystemExit(f"{tools.robot.name}: expected a robot that can fetch the ball")
    return plan.bid.cost, plan.chain


# Driving


@dataclass(frozen=True)
class Setting:
    """What differs between series of episodes.

    Attributes
    ----------
    gate : Gate
        The comparison by which roles change.
    noise : float
        Standard deviation in m of each coordinate of robots and ball, as a robot estimates it.
    lost : float or None
        Share of messages that are lost; None: no communication, each robot observes the others.
    """

    robots: int = 2
    gate: Gate = field(default_factory=Gate)
    noise: float = 0.0
    lost: float | None = 0.0


@dataclass
class Counts:
    """What is counted in an episode, a tick being 0.1 s."""

    ticks: int = 0
    agreed: int = 0
    two_at_ball: int = 0
    longest: int = 0  # ticks in a row with two robots at the ball
    changes: int = 0
    fetched: int = 0


class Errors:
    """Errors of a robot's estimates of positions, which change slowly."""

    def __init__(self, noise: float, rng: np.random.Generator) -> None:
        self._noise = noise
        self._rng = rng
        self._state: dict[str, FloatArray] = {}

    def of(self, name: str) -> FloatArray:
        """Return the present error of a position in m, shape (2,)."""
        fresh = self._rng.normal(0.0, self._noise, 2)
        kept = math.exp(-PERIOD / PERSISTENCE)
        before = self._state.get(name, fresh)
        self._state[name] = kept * before + math.sqrt(1.0 - kept**2) * fresh
        return self._state[name]


@dataclass
class Player:
    """A robot of an episode: what it believes, and what it executes."""

    number: int
    roster: Roster
    errors: Errors
    executor: ChainExecutor | None = None
    chain: TopChain = field(default_factory=partial(TopChain, ()))
    courses: dict[str, Course | None] = field(default_factory=dict)
    role: str = ""
    belief: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The robot's name."""
        return NAMES[self.number]

    def estimate(self, truth: World, name: str) -> World:
        """Return a state with this robot's errors."""
        dx, dy = self.errors.of(name)
        pose = truth.robot.pose
        robot = replace(truth.robot, pose=pose._replace(x=pose.x + dx, y=pose.y + dy))
        dx, dy = self.errors.of(BALL)
        ball = truth.objects[BALL]
        return World(truth.time, robot, {BALL: ObjectState(ball.x + dx, ball.y + dy)})

    def send(self, plan: Plan | None, role: str, world: World) -> None:
        """Execute the role's chain as the node does: a running one that ends there goes on."""
        same = self.executor is not None and role == self.role
        if plan is not None and same and (not plan.chain or plan.goes_on(self.chain, ROBOT.reach)):
            return
        self.stop(world)
        self.role = role
        if plan is not None and plan.chain:
            self.executor = ChainExecutor(LIBRARY, plan.chain, models=TOOLS.models)
            self.chain = plan.chain

    def stop(self, world: World) -> None:
        """End the running chain."""
        if self.executor is not None:
            self.executor.interrupt(world, Ending.CANCELED, "another role")
        self.executor = None


class Episode:
    """Robots that fetch a ball, in one simulation."""

    def __init__(self, setting: Setting, seed: Sequence[int]) -> None:
        self._setting = setting
        self._rng = np.random.default_rng(seed)
        self._refiner = TOOLS.refiner()
        self._players = [
            Player(
                number,
                Roster(NAMES[number], TIMEOUT, -TIMEOUT),
                Errors(setting.noise, self._rng),
            )
            for number in range(setting.robots)
        ]
        self._messages: list[tuple[float, Player, Member]] = []
        self._doubled = 0  # ticks since which two robots have had the ball's role
        self.counts = Counts()

    def run(self, duration: float) -> Counts:
        """Return what was counted in some s."""
        with Simulation(ROBOT, robots=self._setting.robots) as simulation:
            *starts, ball = places(self._rng, self._setting.robots + 1)
            for number, (x, y) in enumerate(starts):
                yaw = self._rng.uniform(-math.pi, math.pi)
                simulation.place_robot(Pose(x, y, yaw), number=number)
            simulation.place_object(BALL, *ball)
            offset = PERIOD / self._setting.robots
            ticks = round(duration / TICK)
            for tick, player in itertools.product(range(ticks), self._players):
                first = round(player.number * offset / TICK)
                if tick % round(PERIOD / TICK) == first:
                    self._decide(player, simulation)
                self._drive(player, simulation)
                if player is self._players[-1]:
                    simulation.tick()
                    if tick % 2:
                        self._count()
            for player in self._players:
                player.stop(simulation.world(number=player.number))
        return self.counts

    def _decide(self, player: Player, simulation: Simulation) -> None:
        now = simulation.time
        for message in [each for each in self._messages if each[0] <= now]:
            self._messages.remove(message)
            message[1].roster.take(message[2], now)
        truth = simulation.world(number=player.number)
        roles = ROLES[: self._setting.robots]
        before = player.roster.role()
        own = Member(player.name, player.estimate(truth, player.name), ROBOT.reach, before)
        player.roster.take(own, now)
        seen = self._seen(player, simulation) if self._setting.lost is None else []
        for member in seen:
            player.roster.take(member, now)
        objects = common_objects(player.roster.members(now), ROBOT)
        plans = {}
        for member in (own, *seen):
            plans[member.name] = plan_roles(
                member.world,
                roles,
                self._refiner,
                LIBRARY,
                objects,
                barred=player.roster.barred(now) if member is own else (),
                course=player.courses.get(member.name),
            )
        for member in (own, *seen):
            player.roster.take(replace(member, bids=bids_of(plans[member.name])), now)
        found = player.roster.decide(roles, now, self._setting.gate)
        player.belief = {each.name: each.role for each in player.roster.members(now)}
        for member in (own, *seen):
            role = player.belief[member.name]
            course = player.courses.get(member.name)
            player.courses[member.name] = (
                course_in(role, plans[member.name][role], course, now, ROBOT.reach)
                if role
                else None
            )
        role = player.roster.role()
        self.counts.changes += bool(before) and role != before
        plan = plans[player.name].get(role)
        own = replace(own, bids=bids_of(plans[player.name]))
        player.send(None if found.waits(player.name) else plan, role, truth)
        if self._setting.lost is not None:
            for other in self._others(player):
                if self._rng.random() >= self._setting.lost:
                    self._messages.append((now + DELAY, other, replace(own, role=role)))

    def _seen(self, player: Player, simulation: Simulation) -> list[Member]:
        """Return the other robots as a robot observes them, with the roles that it expects."""
        return [
            Member(
                other.name,
                player.estimate(simulation.world(number=other.number), other.name),
                ROBOT.reach,
                player.belief.get(other.name, ""),
            )
            for other in self._others(player)
        ]

    def _others(self, player: Player) -> Iterator[Player]:
        return (other for other in self._players if other is not player)

    def _drive(self, player: Player, simulation: Simulation) -> None:
        if player.executor is None:
            simulation.command(STOP, number=player.number)
            return
        world = simulation.world(number=player.number)
        step = player.executor.step(world)
        if step.command is not None:
            simulation.command(step.command, number=player.number)
        if step.status is Status.RUNNING:
            return
        player.stop(world)
        if step.status is Status.SUCCEEDED and player.role == "ball":
            self.counts.fetched += 1
            self._put_ball(simulation)

    def _put_ball(self, simulation: Simulation) -> None:
        """Put the ball elsewhere, away from the robots."""
        while True:
            (place,) = places(self._rng, 1)
            poses = [simulation.world(number=each.number).robot.pose for each in self._players]
            if min(math.hypot(place[0] - pose.x, place[1] - pose.y) for pose in poses) > 1.0:
                simulation.place_object(BALL, *place)
                return

    def _count(self) -> None:
        counts = self.counts
        counts.ticks += 1
        beliefs = [player.belief for player in self._players]
        counts.agreed += all(belief == beliefs[0] for belief in beliefs)
        is_double = sum(player.role == "ball" for player in self._players) > 1
        counts.two_at_ball += is_double
        self._doubled = self._doubled + 1 if is_double else 0
        counts.longest = max(counts.longest, self._doubled)


HEADER = (
    "all agree (% of ticks)",
    "changes of role (1/min)",
    "two at the ball (% of ticks)",
    "at most (s)",
    "balls (1/min)",
)


def row(setting: Setting, episodes: int, duration: float, seed: int) -> str:
    """Return a line of a table: the counts of a series of episodes."""
    found = [Episode(setting, [seed, number]).run(duration) for number in range(episodes)]
    minutes = duration / 60.0
    cells = (
        interval([100.0 * each.agreed / each.ticks for each in found], 1),
        interval([each.changes / minutes / setting.robots for each in found], 1),
        interval([100.0 * each.two_at_ball / each.ticks for each in found], 1),
        f"{0.1 * max(each.longest for each in found):.1f}",
        interval([each.fetched / minutes for each in found], 1),
    )
    return " | ".join(cells)


def driving(robots: int, episodes: int, duration: float, seed: int) -> None:
    """Print the table with and without the rule that a change of roles must pay."""
    print(f"| robots | rule | {' | '.join(HEADER)} |\n{'| --- ' * 7}|", flush=True)
    for name, gate in (("gain above its uncertainty", Gate()), ("any gain", NO_GATE)):
        setting = Setting(robots, gate)
        print(f"| {robots} | {name} | {row(setting, episodes, duration, seed)} |", flush=True)


def noise(robots: int, episodes: int, duration: float, seed: int) -> None:
    """Print the table for errors of positions and lost messages."""
    print(f"| messages | noise (m) | {' | '.join(HEADER)} |\n{'| --- ' * 7}|", flush=True)
    for name, lost in (("all", 0.0), ("30 % lost", 0.3), ("none", None)):
        for deviation in (0.0, 0.1, 0.5):
            setting = Setting(robots, noise=deviation, lost=lost)
            print(
                f"| {name} | {deviation:g} | {row(setting, episodes, duration, seed)} |", flush=True
            )


def main() -> None:
    """Run one of the series."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("series", choices=("standing", "driving", "noise"))
    parser.add_argument("--robots", type=int, default=2)
    parser.add_argument("--situations", type=int, default=500)
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--duration", type=float, default=30.0, help="s of an episode")
    parser.add_argument("--seed", type=int, default=8100)
    parser.add_argument("--mate", default="", help="file of the other robots (default: the same)")
    parser.add_argument("--mate-models", default="", help="folder of their models")
    options = parser.parse_args()
    if options.series == "standing":
        own = TOOLS, LIBRARY
        source = ToolsetSource(robot=options.mate, models=options.mate_models)
        mate = tools_of(source) if options.mate else own
        standing([own, *[mate] * (options.robots - 1)], options.situations, options.seed)
    elif options.series == "driving":
        driving(options.robots, options.episodes, options.duration, options.seed)
    else:
        noise(options.robots, options.episodes, options.duration, options.seed)


if __name__ == "__main__":
    main()
