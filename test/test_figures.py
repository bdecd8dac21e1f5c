"""The script of figures 4 and 6."""

from __future__ import annotations

from pathlib import Path

from scripts import figures


def test_both_figures_are_drawn(tmp_path: Path) -> None:
    assert figures.main(["--action-set", "bezier", "--out", str(tmp_path)]) == 0
    assert "angle_at_dest (degree)" in (tmp_path / "figure4_bezier.svg").read_text()
    assert "together" in (tmp_path / "figure6_bezier.svg").read_text()
