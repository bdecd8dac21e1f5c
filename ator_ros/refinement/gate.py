"""The gate: refine only where it is expected to pay (paper, section 5, "after filtering")."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

from ator_ros.actions import DEFAULT_SET
from ator_ros.files import FileError, load, save
from ator_ros.geometry import wrap_angle
from ator_ros.printable import quoted
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.schema import OneOf
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

FEATURES: Mapping[str, str] = {
    "gain": "s, predicted",
    "relative_gain": "predicted gain over predicted cost before",
    "spread": "s, of the difference between the two predictions",
    "before": "s, predicted cost",
    "turned": "rad, greatest change of a subgoal's heading",
    "distance": "m, from the robot to the first subgoal",
    "next_distance": "m, from the first subgoal to the next goal",
    "bend": "rad, 0 where robot, first subgoal and next goal lie on a line in this order",
}
"""The features of a gate, with their units."""


def gate_features(
    world: World,
    chain: TopChain,
    best: TopChain,
    before: ChainPrediction,
    after: ChainPrediction,
) -> dict[str, float]:
    """Return the values of `FEATURES` for a chain and the best one found."""
    robot, first = world.robot.pose, chain.calls[0].goal.pose
    following = chain.calls[min(1, len(chain.calls) - 1)].goal.pose
    leg = math.atan2(first.y - robot.y, first.x - robot.x)
    next_leg = math.atan2(following.y - first.y, following.x - first.x)
    gain = before.cost - after.cost
    turns = [
        abs(wrap_angle(new.goal.pose.yaw - old.goal.pose.yaw))
        for old, new in zip(chain.calls, best.calls, strict=True)
    ]
    relative = gain / before.cost if before.cost > 0.0 else 0.0
    return {
        "gain": gain,
        "relative_gain": 1.0 if math.isnan(relative) else relative,  # both are infinite
        "spread": math.hypot(before.spread, after.spread),
        "before": before.cost,
        "turned": max(turns),
        "distance": robot.distance(first),
        "next_distance": first.distance(following),
        "bend": abs(wrap_angle(next_leg - leg)),
    }


@dataclass(frozen=True, slots=True)
class ThresholdGate:
    """Refines where the predicted gain exceeds a threshold that grows with the models' spread.

    Attributes
    ----------
    gain : float
        Least predicted gain in s.
    spread_factor : float
        Added to it per second of spread.
    """

    gain: float
    spread_factor: float = 0.0
    kind: ClassVar[str] = "threshold"

    def needed(self, spread: Any) -> Any:
        """Return the threshold in s at a spread in s, elementwise; the spread may be infinite."""
        return self.gain + self.spread_factor * spread if self.spread_factor else self.gain

    def decide(self, features: Mapping[str, float]) -> tuple[bool, str]:
        """Return whether the predicted gain exceeds the threshold, and the reason in words."""
        needed, gain = float(self.needed(features["spread"])), features["gain"]
        if not (gain > needed or gain >= 0.005):
            return False, "no gain predicted"
        if self == NO_GATE:
            return True, f"predicted gain {gain:.2f} s"
        relation = "is above" if gain > needed else "is not above"
        digits = 2 if f"{gain:.2f}" != f"{needed:.2f}" else 4
        reason = f"predicted gain {gain:.{digits}f} s {relation} the gate's {needed:.{digits}f} s"
        return gain > needed, reason

    def rules(self) -> list[str]:
        """Return the threshold in words."""
        factor = self.spread_factor
        spread = f" + {factor:g} times the spread of the two predictions" if factor else ""
        return [f"refines where the predicted gain is above {self.gain:.2f} s{spread}"]


NO_GATE = ThresholdGate(0.0)
"""Refines wherever a gain is predicted."""
CAUTIOUS = ThresholdGate(0.05, 0.25)
"""The gate of models with which no chain was executed yet: a control tick, and a quarter of the spread."""


@dataclass(frozen=True, slots=True)
class TreeGate:
    """A decision tree that predicts Higher, Equal or Lower from `FEATURES` (paper): Higher is refined.

    Attributes
    ----------
    feature, threshold, left, right : tuples, one item per node
        At node i the branch is left[i] where the value of feature[i] is at most threshold[i], right[i]
        otherwise; a leaf has an empty feature.
    label : tuple of str
        The label of each node.

    Raises
    ------
    ValueError
        The columns differ in length, or a child does not come after its parent.
    """

    feature: tuple[Annotated[str, OneOf(("", *FEATURES))], ...]
    threshold: tuple[float, ...]
    left: tuple[int, ...]
    right: tuple[int, ...]
    label: tuple[Annotated[str, OneOf(("Higher", "Equal", "Lower"))], ...]
    kind: ClassVar[str] = "tree"

    def __post_init__(self) -> None:
        """Check that the columns make a tree."""
        columns = (self.feature, self.threshold, self.left, self.right, self.label)
        if len({len(column) for column in columns}) != 1 or not self.feature:
            raise ValueError("expected lists of one length, at least 1")
        for index, (name, *children) in enumerate(zip(self.feature, self.left, self.right, strict=True)):
            # Children come after their parent, so that following the branches always ends.
            if name and not all(index < child < len(self.feature) for child in children):
                raise ValueError(f"node {index}: expected children from {index + 1}, got {children}")

    def decide(self, features: Mapping[str, float]) -> tuple[bool, str]:
        """Return whether the tree predicts Higher; the reason is the rule that applies."""
        node, conditions = 0, []
        while self.feature[node]:
            name, bound = self.feature[node], self.threshold[node]
            below = features[name] <= bound
            conditions.append(f"{name} {'<=' if below else '>'} {bound:.2f}")
            node = self.left[node] if below else self.right[node]
        label = self.label[node]
        return label == "Higher", f"{label} performance predicted: {' and '.join(conditions) or 'always'}"

    def rules(self) -> list[str]:
        """Return one sentence per leaf, in the order of the leaves."""
        rules: list[str] = []
        stack: list[tuple[int, tuple[str, ...]]] = [(0, ())]
        while stack:
            node, path = stack.pop()
            name, bound = self.feature[node], self.threshold[node]
            if not name:
                rules.append(f"if {' and '.join(path) or 'anything'} then {self.label[node]}")
                continue
            stack.append((self.right[node], (*path, f"{name} > {bound:.3g}")))
            stack.append((self.left[node], (*path, f"{name} <= {bound:.3g}")))
        return rules


Gate = ThresholdGate | TreeGate
"""Decides from the values of `FEATURES` whether to refine."""

# The file

KIND = "gate"
GATE = "gate.json"
"""Name of the file beside the models."""


@dataclass(frozen=True)
class _GateFile:
    """The fields of a gate's file."""

    action_set: str
    kind: str
    gate: Gate
    training: dict[str, Any] = field(default_factory=dict)


def save_gate(path: Path, gate: Gate, training: Mapping[str, Any], action_set: str = DEFAULT_SET) -> None:
    """Write a gate of an action set, with how it was trained, to `path`; atomic."""
    save(path, KIND, _GateFile(action_set, gate.kind, gate, dict(training)))


def add_cautious_gate(folder: Path, action_set: str, command: str) -> bool:
    """Write `CAUTIOUS` beside the models in `folder` if there is no gate; return whether there was none."""
    missing = not os.path.lexists(folder / GATE)
    if missing:
        save_gate(folder / GATE, CAUTIOUS, {"command": command}, action_set)
    return missing


def load_gate(path: Path, action_set: str = DEFAULT_SET) -> Gate:
    """Read the gate of an action set.

    Raises
    ------
    FileError
        The file cannot be read, is no gate, or was learned for other actions; the message names file and
        field.
    """
    file = load(path, KIND, _GateFile)
    if file.action_set != action_set:
        raise FileError(
            f"{path}: action_set: expected {action_set!r}, got {quoted(file.action_set)}: "
            "learn the gate of these actions with the tool gate"
        )
    return file.gate


def gate_in(folder: Path, action_set: str) -> Gate:
    """Read the gate beside the models of an action set as `load_gate` does; `NO_GATE` if there is none."""
    if os.path.lexists(folder / GATE):  # a link that leads nowhere is no missing gate
        return load_gate(folder / GATE, action_set)
    return NO_GATE
