"""Evaluates some policies of a finished evaluation again, after what they choose from has changed.

Executions are deterministic, so the runs of the other policies and of the oracle stay what they are, as long
as simulation and actions do, and robot and described models, by which the oracle leaves out headings. Whether
the former do is seen at the naive chains, which are executed again too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.running import portable
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.evaluation.storage import to_records

_CHOSEN_FROM = ("models", "experience")
_TOGETHER = ("features", "features_speed")
"""Fields of a record that belong to the policies and not to the oracle."""


def settings_again(settings: Settings, policies: Sequence[str]) -> Settings:
    """Return the settings of an evaluation of `policies` and the naive one alone, without an oracle."""
    names = tuple(name for name in settings.policies if name in {"naive", *policies})
    return dataclasses.replace(settings, policies=names, oracle=0, oracle_margin=None, oracle_speeds=())


def former_records(result: Mapping[str, Any], settings: Settings, situations: int) -> list[Record]:
    """Return the records of a finished evaluation of the same settings.

    Raises
    ------
    EvaluationError
        Settings, number of situations, robot or described models are others; the message names what differs.
        Or the oracle is a joint one, which the policies' own chains belong to.
    """
    if settings.joint_oracle:
        raise EvaluationError("--again: a joint oracle depends on the policies: evaluate all of it anew")
    records = same_records(result, settings)
    if len(records) != situations:
        raise EvaluationError(f"expected {situations} situations, the result there has {len(records)}")
    return records


def same_records(result: Mapping[str, Any], settings: Settings, *, but: Sequence[str] = ()) -> list[Record]:
    """Return the records of a finished evaluation of the same settings, `but` those of these names.

    Raises
    ------
    EvaluationError
        Settings, robot or described models are others; the message names what differs.
    """
    former = _compared(result["settings"])
    for name, value in _compared(portable(dataclasses.asdict(settings))).items():
        if name not in but and former.get(name) != value:
            raise EvaluationError(
                f"expected a result of {name} {value}, the result there has {former.get(name)}"
            )
    digests = settings.source.digests(settings.chain)
    if result.get("digests") != digests:
        raise EvaluationError(
            f"expected a result of robot and described models {digests}, "
            f"the result there has {result.get('digests')}: evaluate all of it anew"
        )
    return to_records(result["runs"], result["summary"]["situations"])


def joined(former: Sequence[Record], again: Sequence[Record]) -> list[Record]:
    """Return the former records with the policies that were evaluated again.

    Raises
    ------
    EvaluationError
        A naive chain took another time than before, so other runs would, too.
    """
    return [_joined(old, new) for old, new in zip(former, again, strict=True)]


def _joined(old: Record, new: Record) -> Record:
    before, now = (record["policies"]["naive"] for record in (old, new))
    if any(before[field] != now[field] for field in ("duration", "success", "chosen")):
        raise EvaluationError(
            f"--again: situation {old['index']}: expected the naive run as before, "
            f"{before['duration']} s at {before['chosen']}, got {now['duration']} s at {now['chosen']}: "
            "evaluate all of it anew"
        )
    policies = {name: new["policies"].get(name, run) for name, run in old["policies"].items()}
    features = {name: new[name] for name in _TOGETHER if name in new}
    return {**old, "policies": policies, **features}


def _compared(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings without the files from which policies choose."""
    plain: dict[str, Any] = _plain(settings)
    for name in _CHOSEN_FROM:
        plain["source"].pop(name, None)
    return plain


def _plain(value: Any) -> Any:
    """Return a value of settings as JSON has it."""
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
