"""Learning a gate from executed situations: a threshold, or the paper's decision tree (section 4.4)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.tree import DecisionTreeClassifier

from ator_ros.evaluation.policies import UNGATED
from ator_ros.evaluation.statistics import labels
from ator_ros.geometry import FloatArray
from ator_ros.refinement.gate import FEATURES, ThresholdGate, TreeGate

GAINS = (0.0, 0.02, 0.05, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
SPREAD_FACTORS = (0.0, 0.25, 0.5, 1.0)
KEPT = 0.97
"""Least share of the ungated gain that a gate keeps, with and without refined speeds."""
TREE_DEPTH = 3
TREE_LEAF = 10


class GateExamples(NamedTuple):
    """Situations executed naive and refined.

    Attributes
    ----------
    features : ndarray, shape (n, len(FEATURES))
        Features of the gate.
    naive, refined : ndarray, shape (n,)
        Durations in s.
    kind : ndarray of int, shape (n,)
        0: the heading was refined; 1: heading and arrival speed.
    """

    features: FloatArray
    naive: FloatArray
    refined: FloatArray
    kind: NDArray[np.int64]


def gate_examples(records: Iterable[Mapping[str, Any]]) -> GateExamples:
    """Return the examples in records of `evaluate_trial`, with and without refined arrival speed."""
    rows = []
    for record in records:
        for kind, (policy, key) in enumerate(UNGATED.items()):
            if record.get(key):
                durations = (record["policies"][name]["duration"] for name in ("naive", policy))
                rows.append(([record[key][name] for name in FEATURES], *durations, kind))
    return GateExamples(*map(np.array, zip(*rows, strict=True)))


def fit_threshold(examples: GateExamples) -> ThresholdGate:
    """Return the threshold with the fewest slower runs among those that keep the share `KEPT` of the gain.

    If no threshold keeps so much, it is one of those that keep most.
    """
    gain, spread = (examples.features[:, list(FEATURES).index(name)] for name in ("gain", "spread"))
    gates = [ThresholdGate(least, factor) for least in GAINS for factor in SPREAD_FACTORS]
    refine = [gain > gate.needed(spread) for gate in gates]
    kept = [_kept(examples, rows) for rows in refine]
    allowed = [index for index, share in enumerate(kept) if share >= min(KEPT, max(kept))]
    slower = labels(examples.refined, examples.naive) == "Lower"
    return gates[
        min(allowed, key=lambda index: (np.sum(slower & refine[index]), -_gain(examples, refine[index])))
    ]


def fit_tree(examples: GateExamples) -> TreeGate:
    """Return the decision tree that classifies Higher, Equal and Lower, as in the paper."""
    tree = DecisionTreeClassifier(max_depth=TREE_DEPTH, min_samples_leaf=TREE_LEAF, random_state=0)
    tree.fit(examples.features, labels(examples.refined, examples.naive))
    nodes, names = tree.tree_, list(FEATURES)
    inner = nodes.children_left >= 0
    return TreeGate(
        feature=tuple(names[f] if i else "" for f, i in zip(nodes.feature, inner, strict=True)),
        threshold=tuple(float(t) if i else 0.0 for t, i in zip(nodes.threshold, inner, strict=True)),
        left=tuple(int(child) for child in nodes.children_left),
        right=tuple(int(child) for child in nodes.children_right),
        label=tuple(str(tree.classes_[np.argmax(value[0])]) for value in nodes.value),
    )


def _gain(examples: GateExamples, rows: NDArray[np.bool_]) -> float:
    return float((examples.naive - examples.refined)[rows].sum())


def _kept(examples: GateExamples, refine: NDArray[np.bool_]) -> float:
    """Return the kept share of the ungated gain, of the kind of refinement that keeps least."""
    shares = []
    for kind in np.unique(examples.kind):
        of_kind = examples.kind == kind
        possible = _gain(examples, of_kind)
        shares.append(_gain(examples, refine & of_kind) / possible if possible > 0.0 else 1.0)
    return min(shares)
