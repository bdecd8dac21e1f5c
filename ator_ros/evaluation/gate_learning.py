"""Learning two kinds of gate from executed situations, with cross-validation (paper, section 5).

Of some hundred executed chains only a few become slower, and which ones is chance. The differences of gained
and predicted time of all chains are a better estimate of that risk: see `fit_to_drawn_errors`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata
from sklearn.tree import DecisionTreeClassifier

from ator_ros.evaluation.policies import UNGATED
from ator_ros.evaluation.statistics import labels
from ator_ros.geometry import FloatArray
from ator_ros.refinement.gate import FEATURES, ThresholdGate, TreeGate

LearnedGate = ThresholdGate | TreeGate
GAINS = (0.0, 0.02, 0.05, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
SPREAD_FACTORS = (0.0, 0.25, 0.5, 1.0)
HARM = 3.0
"""Penalty in s for a run that becomes more than 2 % slower, besides the lost time."""
KEPT = 0.97
"""Least share of the ungated gain that a gate keeps, with and without refined speeds."""
MOST_SLOWER = 0.01
"""Share of runs that a gate may let become more than 2 % slower, by cross-validation (paper: 1 %)."""
FOLDS = 10
TREE_DEPTH = 3
TREE_LEAF = 10
DRAWS = 100
"""Errors drawn for each chain: with fewer, the learned threshold varies from 0.02 to 0.4 s."""
_ALIKE = 0.2
"""Share of all chains from which the errors of one are drawn: those with the most similar ranks of predicted
spread and predicted gain.

Errors grow with both, and not in proportion to the spread. Drawn without regard to the gain, errors make two
to three times as many chains slower as executions do, since a chain that gains little has hardly changed.
"""
_FEWEST = 10
LEAST = ThresholdGate(0.05, 0.25)
"""Least threshold: one control tick, and a quarter of the spread.

A few hundred chains show few of the rare large errors. With lower thresholds 4 of 300 chains became slower on
two robots each, with this one 2 and 3.
"""


class GateExamples(NamedTuple):
    """Situations executed naive and refined.

    Attributes
    ----------
    features : ndarray, shape (n, len(FEATURES))
        Features of the gate.
    naive, refined : ndarray, shape (n,)
        Durations in s.
    situation : ndarray of int, shape (n,)
        Index of the situation of each example.
    kind : ndarray of int, shape (n,)
        0: the heading was refined; 1: heading and arrival speed.
    succeeded : ndarray of bool, shape (n,)
        Whether both chains succeeded. Errors are not drawn from failed chains.
    """

    features: FloatArray
    naive: FloatArray
    refined: FloatArray
    situation: NDArray[np.int64]
    kind: NDArray[np.int64]
    succeeded: NDArray[np.bool_]

    @classmethod
    def of(cls, rows: Iterable[tuple[Any, ...]]) -> GateExamples:
        """Return the examples of rows with the values of one each."""
        return cls(*(np.array(column) for column in zip(*rows, strict=True)))

    def part(self, rows: NDArray[Any]) -> GateExamples:
        """Return the examples that `rows` selects."""
        return GateExamples(*(column[rows] for column in self))

    def column(self, name: str) -> FloatArray:
        """Return the values of a feature, shape (n,)."""
        values: FloatArray = self.features[:, list(FEATURES).index(name)]
        return values


def gate_examples(records: Iterable[Mapping[str, Any]]) -> GateExamples:
    """Return the examples in records of `evaluate_trial`, with and without refined arrival speed."""
    rows = []
    for record in records:
        naive = record["policies"]["naive"]
        for kind, (policy, key) in enumerate(UNGATED.items()):
            if record.get(key):
                features, refined = [record[key][name] for name in FEATURES], record["policies"][policy]
                times = naive["duration"], refined["duration"]
                succeeded = naive["success"] and refined["success"]
                rows.append((features, *times, record["index"], kind, succeeded))
    return GateExamples.of(rows)


Fit = Callable[[GateExamples], ThresholdGate]
"""Learns a threshold from examples."""


class LearnedGates(NamedTuple):
    """Both kinds of gate, how `compare_gates` compares them, and the better one."""

    threshold: ThresholdGate
    tree: TreeGate
    comparison: dict[str, dict[str, float]]
    better: LearnedGate

    def training(self, *, command: str, seed: int, situations: int) -> dict[str, Any]:
        """Return how the gate was learned, for its file."""
        return {
            "command": command,
            "seed": seed,
            "situations": situations,
            "cross_validation": self.comparison,
            "tree_rules": self.tree.rules(),
            "threshold": {"gain": self.threshold.gain, "spread_factor": self.threshold.spread_factor},
        }


def fit_threshold(examples: GateExamples, *, keep: float = KEPT) -> ThresholdGate:
    """Return the threshold with the fewest slower runs among those that keep the share `keep` of the gain.

    If no threshold keeps so much, it is one of those that keep most.

    Parameters
    ----------
    examples : GateExamples
        Executed situations.
    keep : float
        Least share of the ungated gain of each kind of refinement.
    """
    gates, refine = _thresholds(examples, ThresholdGate(0.0))
    kept = [min(_kept(examples, rows)) for rows in refine]
    allowed = [index for index, share in enumerate(kept) if share >= min(keep, max(kept))]
    harm = [_worse(examples, rows) for rows in refine]
    return gates[min(allowed, key=lambda index: (harm[index], -_gain(examples, refine[index])))]


def _thresholds(
    examples: GateExamples, least: ThresholdGate
) -> tuple[list[ThresholdGate], list[NDArray[np.bool_]]]:
    """Return all candidate thresholds from `least` on, and which examples each of them refines."""
    gain, spread = examples.column("gain"), examples.column("spread")
    gains = [each for each in GAINS if each >= least.gain]
    factors = [each for each in SPREAD_FACTORS if each >= least.spread_factor]
    gates = [ThresholdGate(each, factor) for each in gains for factor in factors]
    return gates, [gain > gate.gain + gate.spread_factor * spread for gate in gates]


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


def learn_gates(examples: GateExamples, fit: Fit) -> LearnedGates:
    """Learn and compare both kinds of gate; `fit` learns the threshold.

    The better kind is the one with the greater utility among those with at most a share `MOST_SLOWER` of
    slower runs that keep `KEPT` of the gain; if neither does, among both.
    """
    comparison, threshold, tree = compare_gates(examples, fit), fit(examples), fit_tree(examples)
    kinds: dict[str, LearnedGate] = {"threshold": threshold, "tree": tree}
    careful = [
        kind
        for kind, judged in comparison.items()
        if kind in kinds
        and judged["lower"] <= MOST_SLOWER * len(examples.naive)
        and judged["kept_gain_percent"] >= 100.0 * KEPT
    ]
    better = max(careful or kinds, key=lambda kind: comparison[kind]["utility"])
    return LearnedGates(threshold, tree, comparison, kinds[better])


def _gain(examples: GateExamples, refine: NDArray[np.bool_]) -> float:
    return float((examples.naive - examples.refined)[refine].sum())


def _worse(examples: GateExamples, refine: NDArray[np.bool_]) -> int:
    taken = np.where(refine, examples.refined, examples.naive)
    return int(np.sum(labels(taken, examples.naive) == "Lower"))


def _kept(examples: GateExamples, refine: NDArray[np.bool_]) -> list[float]:
    """Return the kept share of the ungated gain of each kind of refinement."""
    shares = []
    for kind in np.unique(examples.kind):
        of_kind = examples.kind == kind
        possible = _gain(examples, of_kind)
        shares.append(_gain(examples, refine & of_kind) / possible if possible > 0.0 else 1.0)
    return shares


def _utility(examples: GateExamples, refine: NDArray[np.bool_]) -> float:
    return _gain(examples, refine) - HARM * _worse(examples, refine)


def compare_gates(examples: GateExamples, fit: Fit) -> dict[str, dict[str, float]]:
    """Evaluate both kinds of gate by cross-validation over situations; `fit` learns the threshold.

    Returns
    -------
    dict
        For "open" (refine always), "threshold" and "tree": utility (s), mean_gain_s, kept_gain_percent (of
        that of "open"), higher, equal, lower (examples), and refined_percent; for the tree also
        accuracy_percent.
    """
    situations = np.random.default_rng(0).permutation(np.unique(examples.situation))
    refine = {"open": np.ones(len(examples.naive), bool)}
    refine |= {kind: np.zeros(len(examples.naive), bool) for kind in ("threshold", "tree")}
    correct = 0
    for fold in range(FOLDS):
        held_out = np.isin(examples.situation, situations[fold::FOLDS])
        rest, test = examples.part(~held_out), examples.part(held_out)
        threshold, tree = fit(rest), fit_tree(rest)
        rows = [dict(zip(FEATURES, row, strict=True)) for row in test.features]
        refine["threshold"][held_out] = [threshold.decide(row)[0] for row in rows]
        refine["tree"][held_out] = [tree.decide(row)[0] for row in rows]
        predicted = np.array([tree.predicted(row) for row in rows])
        correct += int(np.sum(predicted == labels(test.refined, test.naive)))
    results = {name: _judged(examples, rows) for name, rows in refine.items()}
    results["tree"]["accuracy_percent"] = round(100.0 * correct / len(examples.naive), 1)
    return results


def _judged(examples: GateExamples, refine: NDArray[np.bool_]) -> dict[str, float]:
    taken = np.where(refine, examples.refined, examples.naive)
    label = labels(taken, examples.naive)
    possible = float(np.sum(examples.naive - examples.refined))
    gain = float(np.sum(examples.naive - taken))
    return {
        "utility": round(_utility(examples, refine), 3),
        "mean_gain_s": round(gain / len(taken), 4),
        "kept_gain_percent": round(100.0 * gain / possible, 2) if possible else 0.0,
        "higher": int(np.sum(label == "Higher")),
        "equal": int(np.sum(label == "Equal")),
        "lower": int(np.sum(label == "Lower")),
        "refined_percent": round(100.0 * float(refine.mean()), 1),
    }


def fit_to_drawn_errors(examples: GateExamples) -> ThresholdGate:
    """Return the threshold that gains most, less a penalty of `HARM` for each run that becomes slower.

    It is judged by `DRAWS` copies of each example, with errors drawn from those of chains like it. An error
    is the gained less the predicted time (s) of a chain of the same kind. Errors are drawn at evenly spaced
    ranks, not at random. Neither number of the threshold is below that of `LEAST`.
    """
    gain, spread = examples.column("gain"), examples.column("spread")
    actual = examples.naive - examples.refined
    saved = np.tile(actual, (DRAWS, 1))
    for kind in np.unique(examples.kind):
        rows = np.flatnonzero((examples.kind == kind) & (gain > 0.0) & examples.succeeded)
        errors, ranks = actual[rows] - gain[rows], rankdata([gain[rows], spread[rows]], axis=1)
        count = max(_FEWEST, round(_ALIKE * len(rows)))
        for place, row in enumerate(rows):
            apart = np.abs(ranks - ranks[:, place, None]).sum(axis=0)
            alike = np.sort(errors[np.argsort(apart, kind="stable")[:count]])
            evenly = (np.arange(DRAWS) + 0.5) * (len(alike) / DRAWS)
            saved[:, row] = gain[row] + alike[evenly.astype(np.intp)]
    many = examples.part(np.tile(np.arange(len(gain)), DRAWS))
    many = many._replace(refined=many.naive - saved.ravel())
    gates, refine = _thresholds(many, LEAST)
    return gates[max(range(len(gates)), key=lambda index: _utility(many, refine[index]))]
