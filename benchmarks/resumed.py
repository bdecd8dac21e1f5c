"""Long measurements that go on where they were interrupted."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from ator_ros.files import write_text

Item = TypeVar("Item")
Record = dict[str, Any]


class OtherResultsError(RuntimeError):
    """The partial results are of another measurement."""


def resumed(
    partial: Path, identity: Mapping[str, Any], items: Sequence[Item], measure: Callable[[Item], Record]
) -> list[Record]:
    """Measure the items that are not in the partial results yet; return the records of all.

    Parameters
    ----------
    partial : Path
        JSON lines: the identity, and a record of each item in their order. The caller removes the file once
        the result is written.
    identity : mapping
        What the records depend on.
    items, measure
        What is measured, and what measures one.

    Raises
    ------
    OtherResultsError
        The file holds results of another identity.
    """
    head = json.dumps(identity)
    lines = partial.read_text(encoding="utf-8").split("\n") if partial.exists() else [head, ""]
    if lines[0] != head:
        raise OtherResultsError(f"{partial}: expected results of {head}, got others: {lines[0][:200]}")
    records: list[Record] = [json.loads(line) for line in lines[1:-1]]
    write_text(partial, "\n".join([head, *lines[1:-1], ""]))  # without a line that was cut off
    with partial.open("a", encoding="utf-8") as file:
        for item in tqdm(items[len(records) :], initial=len(records), total=len(items), disable=None):
            records.append(measure(item))
            file.write(json.dumps(records[-1], separators=(",", ":")) + "\n")
            file.flush()
    return records
