"""Kinds of ideal motions that are chosen for a robot, and kept with the models that are learned with them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ator_ros.performance.features import Feature, Kinds
from ator_ros.robot.description import Robot


def chosen_for(features: Sequence[Feature], robot: Robot) -> tuple[Feature, ...]:
    """Return the same features, those of ideal motions with kinds that are chosen for a robot.

    It takes seconds.
    """
    kinds: dict[str, Sequence[Sequence[float | None]]] = {}
    for motions in dict.fromkeys(feature.motions for feature in features):
        kinds |= motions.choose(robot) if motions is not None else {}
    return tuple(with_kinds({feature.name: feature for feature in features}, kinds).values())


def with_kinds(features: Mapping[str, Feature], kinds: Kinds) -> dict[str, Feature]:
    """Return the same features by name, those of ideal motions with these kinds.

    Raises
    ------
    ValueError
        The kinds are not what the features are made of.
    """
    made: dict[str, Feature] = {}
    for motions in dict.fromkeys(feature.motions for feature in features.values()):
        made |= motions.make(kinds) if motions is not None else {}
    return {name: made.get(name, feature) for name, feature in features.items()}


def kinds_of(features: Iterable[Feature]) -> dict[str, Sequence[Sequence[float | None]]]:
    """Return the kinds that were chosen for the features; none where they are the domain's own."""
    kinds: dict[str, Sequence[Sequence[float | None]]] = {}
    for feature in features:
        kinds |= feature.kinds or {}
    return kinds
