"""A terminal that knows ASCII only ends no command."""

from __future__ import annotations

import io
import sys

import pytest

from ator_ros.tools import train


def shown(monkeypatch: pytest.MonkeyPatch, name: str, words: list[str]) -> tuple[int, str]:
    """Run `train` on a terminal with PYTHONIOENCODING=ascii; return exit code and text of a stream."""
    raw = io.BytesIO()
    monkeypatch.setattr(sys, name, io.TextIOWrapper(raw, "ascii", write_through=True))
    code = train.main(words)
    return code, raw.getvalue().decode("ascii")


def test_rules_are_printed_in_ascii(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text = shown(monkeypatch, "stdout", ["--rules", "goToPose"])
    assert code == 0
    assert " deg" in text
    assert "+- " in text


def test_an_error_that_names_a_file_in_another_script_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text = shown(monkeypatch, "stderr", ["böse.parquet"])
    assert code == 1
    assert text.startswith("train: b\\xf6se.parquet: expected a Parquet file")
    assert text.count("\n") == 1
