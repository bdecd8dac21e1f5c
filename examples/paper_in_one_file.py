"""The paper in one file: Stulp and Beetz, "Optimized Execution of Action Chains" (IJCAI 2005).

A robot goes to a ball, with a heading that the plan leaves open, and dribbles it to a pose. This
program learns from experience how long both actions take, chooses the heading with which the chain
is predicted to be fastest, and prints the paper's Table 1 in small:

    scripts/run python examples/paper_in_one_file.py

Comments name the sections of the paper. Simulation and actions, which follow Bezier curves, are
imported.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import product, repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.tree import DecisionTreeClassifier
from tqdm import tqdm

from ator_ros.actions.base import ActionError, Goal, Point, Status
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.state import World

SOCCER = find_domain("soccer")
ROBOT = SOCCER.robot()
ACTIONS = SOCCER.actions("bezier")
CHAIN = ("goToPose", "dribbleBall")
TIME_LIMIT = 30.0  # s, of an action alone and of a chain


# Section 3, learning performance models
#
# 1) "From experience": each action is executed in random situations. The paper learns from the
# states at 10 Hz. Here only the starts are examples, because the features contain no velocity.


def observe(action: str, seed: int, number: int) -> tuple[FloatArray, float]:
    """Return a random situation, shape (7,), and an action's duration in s, NaN if it fails."""
    random = np.random.default_rng([seed, CHAIN.index(action), number])
    drawn = ACTIONS[action].sample(ROBOT, random)
    with Simulation(ROBOT) as simulation:
        place(simulation, World(0.0, drawn.robot, drawn.objects))
        succeeded = execute(simulation, action, drawn.goal)
        return situation_of(drawn.robot.pose, drawn.goal), simulation.time if succeeded else np.nan


def execute(simulation: Simulation, action: str, goal: Goal) -> bool:
    """Execute an action until it ends or the time limit; return whether it succeeded."""
    time_left = TIME_LIMIT - simulation.time
    try:
        end = run_action(simulation, ACTIONS[action].factory(ROBOT), goal, time_limit=time_left)
    except ActionError:  # it cannot start: the preceding action has lost the ball
        return False
    return end.status is Status.SUCCEEDED


def situation_of(start: Pose, goal: Goal) -> FloatArray:
    """Return x, y, yaw, xg, yg, yawg (m, rad), and the distance kept from the goal (m).

    At a ball, the axle stops behind the goal, so that the ball is at the robot's front.
    """
    return np.array([*start, *goal.pose, ROBOT.hold if goal.point is Point.HOLD else 0.0])


# 2) "Using a transformed state space": derived variables that correlate better with the duration.
# The model tree selects from the paper's eleven.

FEATURES = (
    "x",
    "y",
    "yaw",
    "xg",
    "yg",
    "yawg",
    "dx",
    "dy",
    "dist",
    "angle_to_dest",
    "angle_at_dest",
)
ANGLES = ("yaw", "yawg", "angle_to_dest", "angle_at_dest")


def features_of(situations: FloatArray) -> FloatArray:
    """Return the features, shape (n, 11) in m and rad, of situations, shape (n, 7)."""
    x, y, yaw, xg, yg, yawg, behind = situations.T
    dx, dy = xg - behind * np.cos(yawg) - x, yg - behind * np.sin(yawg) - y
    dist = np.hypot(dx, dy)
    # Within 4 cm of the destination, the bearing is noise and is blended into the heading there.
    pull = 20.0 * np.maximum(0.04 - dist, 0.0)
    bearing = np.arctan2(dy + pull * np.sin(yawg), dx + pull * np.cos(yawg))
    angle_to, angle_at = np.abs(wrap_angles(bearing - yaw)), np.abs(wrap_angles(yawg - bearing))
    return np.column_stack([x, y, yaw, xg, yg, yawg, dx, dy, dist, angle_to, angle_at])


# 3) "By partitioning the state space" and 4) "by approximating functions to the data in each of
# these partitions": a model tree, learned as M5' does (Wang and Witten 1997), with one exception: a
# split is judged by the errors of linear models on its two sides, not by the deviations from their
# means.

LEAST_LEAF = 25  # examples
THRESHOLDS = 15  # candidates for each feature, at quantiles
SMOOTHINGS = (5.0, 60.0)  # weight, in examples, of the parent's model
TRACE = 0.01  # share of the error below which a term is removed


@dataclass
class Node:
    """A node of a model tree: its examples, their linear model, and a split unless it is a leaf."""

    table: FloatArray  # features of the examples, (n, 11)
    durations: FloatArray  # in s, (n,)
    constant: float
    slopes: FloatArray  # (11,)
    error: float  # in s, expected error of this subtree for other examples
    feature: int = 0
    threshold: float = 0.0
    below: tuple[Node, Node] | None = None  # children for values up to the threshold, and above it

    def predict(self, table: FloatArray) -> FloatArray:
        """Return durations in s, shape (n,), for features, shape (n, 11)."""
        if self.below is None:
            low, high = self.durations.min(), self.durations.max()
            return np.clip(self.constant + table @ self.slopes, 2.0 * low - high, 2.0 * high - low)
        left, right = (node.predict(table) for node in self.below)
        return np.where(table[:, self.feature] <= self.threshold, left, right)


def learn(table: FloatArray, durations: FloatArray) -> Node:
    """Learn a model tree from features, shape (n, 11), and durations, shape (n,).

    Cross-validation in three folds chooses the smoothing.
    """
    fold, errors = np.arange(len(table)) % 3, dict.fromkeys(SMOOTHINGS, 0.0)
    for smoothing, held in product(SMOOTHINGS, range(3)):
        tree = smooth(grow(table[fold != held], durations[fold != held]), smoothing)
        errors[smoothing] += np.abs(
            tree.predict(table[fold == held]) - durations[fold == held]
        ).sum()
    return smooth(grow(table, durations), min(SMOOTHINGS, key=lambda smoothing: errors[smoothing]))


def grow(table: FloatArray, durations: FloatArray) -> Node:
    """Grow a tree.

    A node stays a leaf if the expected error of its own model is not above its children's.
    """
    node = Node(table, durations, *linear_model(table, durations))
    split = best_split(table, durations)
    if split is not None:
        node.feature, node.threshold = split
        left = table[:, node.feature] <= node.threshold
        below = grow(table[left], durations[left]), grow(table[~left], durations[~left])
        error = sum(len(part.durations) * part.error for part in below) / len(durations)
        if error < node.error:
            node.error, node.below = error, below
    return node


def best_split(table: FloatArray, durations: FloatArray) -> tuple[int, float] | None:
    """Return the feature and the threshold with the least error.

    None if there are too few examples.
    """
    count, least, best = len(table), np.inf, None
    candidates = min(THRESHOLDS, count // LEAST_LEAF) if count >= 2 * LEAST_LEAF else 0
    for feature, column in enumerate(table.T):
        ordered = np.sort(column)
        for number in range(1, candidates + 1):
            value = ordered[int(np.ceil(count * number / (candidates + 1))) - 1]
            sides = [column <= value, column > value]
            if min(map(np.sum, sides)) < LEAST_LEAF:
                continue
            error = 0.0
            for side in sides:
                _, _, expected = least_squares(table[side], durations[side], len(FEATURES) + 1)
                error += np.sum(side) * expected
            if error < (1.0 - 1e-6) * least:
                least, best = error, (feature, float(value + column[sides[1]].min()) / 2.0)
    return best


def linear_model(table: FloatArray, durations: FloatArray) -> tuple[float, FloatArray, float]:
    """Return constant, slopes and expected error of a linear model with few terms.

    Terms are removed one by one while the expected error does not increase; each counts twice.
    """
    columns = list(range(len(FEATURES)))
    best = least_squares(table, durations, 2 * len(columns) + 2)
    while columns:
        fewer = [[column for column in columns if column != removed] for removed in columns]
        models = [least_squares(table[:, kept], durations, 2 * len(kept) + 2) for kept in fewer]
        number = int(np.argmin([error for _, _, error in models]))
        if models[number][2] > best[2]:
            break
        best, columns = models[number], fewer[number]
    constant, few, error = best
    slopes = np.zeros(len(FEATURES))
    slopes[columns] = few
    return constant, slopes, error


def least_squares(
    table: FloatArray, durations: FloatArray, terms: int
) -> tuple[float, FloatArray, float]:
    """Return constant, slopes and expected error of the linear model of all columns of a table.

    The error is M5's estimate for other examples and this number of terms.
    """
    mean, mean_duration, count = table.mean(axis=0), durations.mean(), len(table)
    centered, rest = table - mean, durations - mean_duration
    # The diagonal makes the solution unique for linearly dependent features.
    moments = centered.T @ centered / count + 1e-6 * np.eye(table.shape[1])
    slopes = np.linalg.solve(moments, centered.T @ rest / count)
    error = np.sqrt(np.mean((rest - centered @ slopes) ** 2))
    factor = (count + terms) / (count - terms) if count > terms else np.inf
    return float(mean_duration - mean @ slopes), slopes, float(error * factor)


def smooth(node: Node, smoothing: float) -> Node:
    """Mix each node's model with its parent's; remove terms with little effect from leaves."""
    for part in node.below or ():
        share = len(part.durations) / (len(part.durations) + smoothing)
        part.constant = share * part.constant + (1.0 - share) * node.constant
        part.slopes = share * part.slopes + (1.0 - share) * node.slopes
        smooth(part, smoothing)
    if node.below is None:
        error = np.sqrt(np.mean((node.durations - node.constant - node.table @ node.slopes) ** 2))
        traces = np.abs(node.slopes) * node.table.std(axis=0) < TRACE * error
        node.constant += float(node.table.mean(axis=0)[traces] @ node.slopes[traces])
        node.slopes = np.where(traces, 0.0, node.slopes)
    return node


def rules(node: Node, conditions: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the tree as rules in the paper's form, with angles in degrees."""
    degree = [np.radians(1.0) if name in ANGLES else 1.0 for name in FEATURES]
    if node.below is None:
        terms = zip(node.slopes * degree, FEATURES, strict=True)
        model = "".join(f"{slope:+.3g}*{name} " for slope, name in terms if slope)
        yield f"if {' & '.join(conditions) or 'any'} then time = {model}{node.constant:+.3g}"
        return
    threshold = node.threshold / degree[node.feature]
    for sign, part in zip(("<=", ">"), node.below, strict=True):
        yield from rules(part, (*conditions, f"({FEATURES[node.feature]} {sign} {threshold:.3g})"))


# Section 4, automatic subgoal refinement
#
# 4.1 and 4.2: of the variables that influence performance, the current state cannot be changed, and
# the plan binds the ball's position and the last goal. Only the heading at the ball is free.

HEADINGS = np.linspace(-np.pi, np.pi, 120, endpoint=False)


class Task(NamedTuple):
    """A start and the goals of the chain: at the ball, with a free heading, and the last one."""

    world: World
    subgoal: Goal
    goal: Goal


def with_heading(goal: Goal, yaw: float) -> Goal:
    """Return the goal with another heading in rad."""
    return replace(goal, pose=goal.pose._replace(yaw=float(yaw)))


def features_of_chains(task: Task, headings: Iterable[float]) -> tuple[FloatArray, FloatArray]:
    """Return the features of both actions, shapes (n, 11), for n headings at the ball."""
    subgoals = [with_heading(task.subgoal, yaw) for yaw in headings]
    first = [situation_of(task.world.robot.pose, subgoal) for subgoal in subgoals]
    second = [situation_of(subgoal.robot_pose(ROBOT), task.goal) for subgoal in subgoals]
    return features_of(np.array(first)), features_of(np.array(second))


def choose_headings(models: Mapping[str, Node], task: Task) -> tuple[float, float]:
    """Return the headings (rad) for which the first action (naive), and the chain, are fastest."""
    # 4.3, optimization: the duration of the chain is predicted by summing over the models of its
    # actions.
    tables = zip(CHAIN, features_of_chains(task, HEADINGS), strict=True)
    first, second = (models[action].predict(table) for action, table in tables)
    return float(HEADINGS[np.argmin(first)]), float(HEADINGS[np.argmin(first + second)])


# Section 5, results


def random_task(seed: int, number: int) -> Task:
    """Draw a robot, a ball, and a pose to dribble it to."""
    random = np.random.default_rng([seed, len(CHAIN), number])
    world, chain = SOCCER.chains["dribble"](ROBOT, SOCCER.library(ROBOT, "bezier"), random)
    return Task(world, chain.calls[0].goal, chain.calls[1].goal)


def execute_chain(task: Task, yaw: float) -> float:
    """Execute both actions one after the other.

    Return the duration in s, the time limit if one fails.
    """
    goals = zip(CHAIN, (with_heading(task.subgoal, yaw), task.goal), strict=True)
    with Simulation(ROBOT) as simulation:
        place(simulation, task.world)
        succeeded = all(execute(simulation, action, goal) for action, goal in goals)
        return simulation.time if succeeded else TIME_LIMIT


def labels_of(naive: FloatArray, refined: FloatArray) -> NDArray[np.str_]:
    """Return for each run whether refinement made it Higher, Equal (within 2 %) or Lower."""
    return np.select([refined < 0.98 * naive, refined > 1.02 * naive], ["Higher", "Lower"], "Equal")


def print_table(title: str, naive: FloatArray, refined: FloatArray) -> None:
    """Print one half of Table 1."""
    labels = labels_of(naive, refined)
    groups = [
        np.full(len(labels), True),
        *(labels == name for name in ("Higher", "Equal", "Lower")),
    ]
    saved = [
        100.0 * np.sum((naive - refined)[rows]) / max(np.sum(naive[rows]), 1.0) for rows in groups
    ]
    print(f"\n{title:18}  Total Higher  Equal  Lower")
    print("# runs            ", *(f"{np.sum(rows):6d}" for rows in groups))
    print("improvement       ", *(f"{percent:5.1f}%" for percent in saved))


def experience(
    pool: Executor, action: str, seed: int, numbers: range
) -> tuple[FloatArray, FloatArray]:
    """Return features, shape (n, 11), and durations in s, shape (n,), of successful executions."""
    observed = pool.map(observe, repeat(action), repeat(seed), numbers)
    situations, durations = map(np.array, zip(*tqdm(observed, action, len(numbers)), strict=True))
    return features_of(situations)[np.isfinite(durations)], durations[np.isfinite(durations)]


def run(pool: Executor, episodes: int, situations: int, seed: int) -> None:
    """Learn from `episodes` of each action, and execute chains in `situations` for each half."""
    models = {}
    for action in CHAIN:
        models[action] = learn(*experience(pool, action, seed, range(episodes)))
        table, durations = experience(pool, action, seed, range(episodes, episodes + episodes // 5))
        errors = np.abs(models[action].predict(table) - durations)
        print(
            f"\n{action}: mean absolute error {errors.mean():.2f} s in {len(errors)} new situations"
        )
        print(*rules(models[action]), sep="\n", flush=True)
    tasks = [random_task(seed, number) for number in range(2 * situations)]
    headings = list(zip(*(choose_headings(models, task) for task in tasks), strict=True))
    naive, refined = (
        np.array(list(tqdm(pool.map(execute_chain, tasks, chosen), name, len(tasks))))
        for name, chosen in zip(("naive", "refined"), headings, strict=True)
    )
    print_table("Before filtering", naive[:situations], refined[:situations])
    # A decision tree learns when refinement pays. In the other situations, the chain stays naive.
    pairs = zip(tasks, headings[0], strict=True)
    known = np.array([np.hstack(features_of_chains(task, [yaw]))[0] for task, yaw in pairs])
    tree = DecisionTreeClassifier(max_leaf_nodes=4, random_state=0)
    tree.fit(known[:situations], labels_of(naive, refined)[:situations])
    filtered = np.where(tree.predict(known) == "Higher", refined, naive)
    print_table("After filtering", naive[situations:], filtered[situations:])


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=500, help="of each action: 5 or more")
    parser.add_argument(
        "--situations", type=int, default=100, help="for each half of Table 1: 2 or more"
    )
    parser.add_argument("--seed", type=int, default=1, help="of everything that is random")
    given = parser.parse_args()
    if given.episodes < 5 or given.situations < 2:
        parser.error("expected 5 or more episodes and 2 or more situations")
    with ProcessPoolExecutor() as pool:
        run(pool, given.episodes, given.situations, given.seed)


if __name__ == "__main__":
    main()
