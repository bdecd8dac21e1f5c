"""The gate: refine only where it is expected to pay (paper, section 5, "after filtering")."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

from ator_ros.geometry import wrap_angle
from ator_ros.refinement.averaging import Widths
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

#: What a gate decides from, with units.
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


def gate_features(
    world: World,
    chain: TopChain,
    best: TopChain,
    before: ChainPrediction,
    after: ChainPrediction,
    *,
    averaged: float = math.inf,
) -> dict[str, float]:
    """Return the values of `FEATURES` for a chain and the best one found.

    The gain is the difference of both predictions, or that of `averaged` costs, which are not corrected,
    where it is less.
    """
    robot, first = world.robot.pose, chain.calls[0].goal.pose
    following = chain.calls[min(1, len(chain.calls) - 1)].goal.pose
    leg = math.atan2(first.y - robot.y, first.x - robot.x)
    next_leg = math.atan2(following.y - first.y, following.x - first.x)
    gain = min(before.cost - after.cost, averaged)
    turns = [
        abs(wrap_angle(new.goal.pose.yaw - old.goal.pose.yaw))
        for old, new in zip(chain.calls, best.calls, strict=True)
    ]
    return {
        "gain": gain,
        "relative_gain": _share(gain, before.cost),
        "spread": math.hypot(before.spread, after.spread),
        "before": before.cost,
        "turned": max(turns),
        "distance": robot.distance(first),
        "next_distance": first.distance(following),
        "bend": abs(wrap_angle(next_leg - leg)),
    }


def _share(gain: float, before: float) -> float:
    """Return the gain as a share of the cost before, where that is positive; 1 where both are infinite."""
    if gain == before == math.inf:
        return 1.0
    return gain / before if before > 0.0 else 0.0


class Gate(Protocol):
    """Decides from the values of `FEATURES`; the sentence says why."""

    kind: ClassVar[str]

    @property
    def widths(self) -> Widths:
        """How widely costs are averaged before a chain is chosen; see `ator_ros.refinement.averaging`."""

    @property
    def room(self) -> float:
        """Multiple of the way to stop that arrivals must leave free; see `ator_ros.refinement.room`."""

    @property
    def corrected(self) -> bool:
        """Whether it decides from corrected predictions; see `ator_ros.refinement.calibration`."""

    def decide(self, features: Mapping[str, float]) -> tuple[bool, str]:
        """Return whether to refine, and the reason in words."""


@dataclass(frozen=True, slots=True)
class OpenGate:
    """Refines whenever any gain is predicted.

    Attributes
    ----------
    widths : mapping
        As in `Gate`.
    room : float
        As in `Gate`.
    corrected : bool
        As in `Gate`.
    """

    widths: Widths = field(default_factory=dict)
    room: float = 0.0
    corrected: bool = False
    kind: ClassVar[str] = "open"

    def decide(self, features: Mapping[str, float]) -> tuple[bool, str]:
        """Return whether the predicted gain is above 0."""
        gain = features["gain"]
        return gain > 0.0, f"predicted gain {gain:.2f} s"


@dataclass(frozen=True, slots=True)
class ThresholdGate:
    """Refines where the predicted gain exceeds a threshold that grows with the models' spread.

    Attributes
    ----------
    gain : float
        Least predicted gain in s.
    spread_factor : float
        Added to it per second of spread.
    widths : mapping
        As in `Gate`.
    room : float
        As in `Gate`.
    corrected : bool
        As in `Gate`.
    """

    gain: float
    spread_factor: float = 0.0
    widths: Widths = field(default_factory=dict)
    room: float = 0.0
    corrected: bool = False
    kind: ClassVar[str] = "threshold"

    def decide(self, features: Mapping[str, float]) -> tuple[bool, str]:
        """Return whether the predicted gain exceeds the threshold."""
        needed = self.gain + self.spread_factor * features["spread"]
        gain = features["gain"]
        relation = "is above" if gain > needed else "is not above"
        digits = 2 if f"{gain:.2f}" != f"{needed:.2f}" else 4
        return (
            gain > needed,
            f"predicted gain {gain:.{digits}f} s {relation} the gate's {needed:.{digits}f} s",
        )


@dataclass(frozen=True, slots=True)
class TreeGate:
    """A decision tree that predicts Higher, Equal or Lower from `FEATURES` (paper): Higher is refined.

    Attributes
    ----------
    feature, threshold, left, right : sequences, one item per node
        At node i the branch is left[i] where the value of feature[i] is at most threshold[i], right[i]
        otherwise; a leaf has an empty feature.
    label : sequence of str
        The label of each node.
    widths : mapping
        As in `Gate`.
    room : float
        As in `Gate`.
    corrected : bool
        As in `Gate`.
    """

    feature: Sequence[str]
    threshold: Sequence[float]
    left: Sequence[int]
    right: Sequence[int]
    label: Sequence[str]
    widths: Widths = field(default_factory=dict)
    room: float = 0.0
    corrected: bool = False
    kind: ClassVar[str] = "tree"

    def decide(self, features: Mapping[str, float]) -> tuple[bool, str]:
        """Return whether the tree predicts Higher; the reason is the rule that applies."""
        label, rule = self._applied(features)
        return label == "Higher", f"{label} performance predicted: {rule}"

    def predicted(self, features: Mapping[str, float]) -> str:
        """Return the predicted label."""
        return self._applied(features)[0]

    def _applied(self, features: Mapping[str, float]) -> tuple[str, str]:
        """Return the label of the leaf that the features lead to, and the rule of that leaf."""
        node, conditions = 0, []
        while self.feature[node]:
            name, bound = self.feature[node], self.threshold[node]
            below = features[name] <= bound
            conditions.append(f"{name} {'<=' if below else '>'} {bound:.2f}")
            node = self.left[node] if below else self.right[node]
        return self.label[node], " and ".join(conditions) or "always"

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


def opened(gate: Gate) -> OpenGate:
    """Return the open gate that has chains searched, and judges predictions, as `gate` does."""
    return OpenGate(gate.widths, gate.room, gate.corrected)
