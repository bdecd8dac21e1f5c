"""Prune and smooth a grown model tree, as M5 does (Quinlan 1992; Wang and Witten 1997)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray

# Deviation of a term, as a share of the model's error, below which it is a trace.
_TRACE = 0.01

Children = Sequence[tuple[int, int] | None]


def prune(children: Children, error: FloatArray, weight: FloatArray) -> BoolArray:
    """Return the nodes that become leaves: their own model is expected to err no more than the tree below.

    Parameters
    ----------
    children : sequence of (int, int) or None, length n_nodes
        Nodes below, which have higher numbers; None at a grown leaf.
    error : array of float, shape (n_nodes,)
        Corrected error of each node's own linear model.
    weight : array of float, shape (n_nodes,)
        Total weight of each node's rows.

    Returns
    -------
    array of bool, shape (n_nodes,)
        True also at grown leaves; what lies below a leaf is cut off.
    """
    is_leaf = np.ones(len(error), dtype=bool)
    best = error.copy()
    for node in reversed(range(len(error))):
        below = children[node]
        if below is None:
            continue
        first, second = below
        of_subtree = (weight[first] * best[first] + weight[second] * best[second]) / weight[node]
        is_leaf[node] = error[node] <= of_subtree
        best[node] = min(error[node], of_subtree)
    return is_leaf


def smooth(children: Children, models: FloatArray, samples: FloatArray, *, smoothing: float) -> FloatArray:
    """Fold M5's smoothing into the models: each is mixed with the smoothed model above it.

    M5 filters a prediction p on its way up to the root, p' = (n p + k q) / (n + k) with q predicted by the
    node above. All of these are linear in the features, so that mixing coefficients once predicts the same.

    Parameters
    ----------
    children, samples
        As in `prune`; `samples` are n.
    models : array of float, shape (n_nodes, 1 + n_features)
    smoothing : float
        k, how many samples the model above counts for; 0 for none.
    """
    smoothed = models.copy()
    for node, below in enumerate(children):
        for child in below or ():
            share = samples[child] / (samples[child] + smoothing)
            smoothed[child] = share * models[child] + (1 - share) * smoothed[node]
    return smoothed


def drop_traces(models: FloatArray, moments: FloatArray, error: FloatArray) -> FloatArray:
    """Drop terms that move a node's prediction by next to nothing.

    Smoothing leaves traces of the terms of all models above. They would clutter the rules and count as
    features that influence performance (paper, section 4.2). A term goes if its deviation over a node's rows
    is less than a hundredth of the error; the constant takes over its mean.

    Parameters
    ----------
    models : array of float, shape (n_nodes, 1 + n_features)
    moments : array of float, shape (n_nodes, 2 + n_features, 2 + n_features)
        Normal equations of the nodes.
    error : array of float, shape (n_nodes,)
        Root-mean-square error of each model.
    """
    features = np.arange(1, models.shape[1])
    weight = moments[:, :1, 0]
    mean = moments[:, 0, 1:-1] / weight
    variance = np.maximum(moments[:, features, features] / weight - mean**2, 0.0)
    is_trace = np.abs(models[:, 1:]) * np.sqrt(variance) < _TRACE * error[:, None]
    traces = np.where(is_trace, models[:, 1:], 0.0)
    return np.column_stack([models[:, 0] + (traces * mean).sum(axis=1), models[:, 1:] - traces])
