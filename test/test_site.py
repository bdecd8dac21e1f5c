"""The site of `make docs`, and the reference that is generated for it."""

import os
import subprocess
from pathlib import Path

import pytest
from documentation import ROOT, TOOLS

from scripts import reference


def section(page: str, name: str, level: str = "##") -> str:
    return page.partition(f"\n{level} {name}\n")[2].partition(f"\n{level} ")[0]


def test_the_reference_has_all_parameters() -> None:
    page = reference.nodes_page()
    for name, module in reference.programs("nodes").items():
        rows = section(page, name)
        for item in reference.declared(module):
            assert f"| `{item.name}` | {reference.type_of(item.default)} | " in rows
    simulation = section(page, "simulation")
    assert "cmd_vel (geometry_msgs/Twist)" in simulation
    fast = "| `real_time_factor` | double | `1.0` | 0 to 100 | live | simulated per real seconds; "
    assert fast in simulation
    assert "| `OBJECT_start` | double array | `[0.0, 0.0]` |  | read-only | " in simulation


def test_the_reference_has_all_interfaces_with_their_comments() -> None:
    page = reference.interfaces_page()
    files = sorted((ROOT / "ator_interfaces").glob("*/*"))
    assert [file.name for file in files if not section(page, file.stem, "###")] == []
    assert "| `uint8 SUCCEEDED=1` | the goal is reached |" in section(page, "Outcome", "###")
    assert "| `float64 elapsed` | s since the chain's start, " in section(
        page, "ExecuteChain", "###"
    )


def test_the_reference_has_all_tools() -> None:
    page = reference.tools_page()
    assert [name for name in TOOLS if f"```text\nusage: {name} " not in section(page, name)] == []


@pytest.mark.long
@pytest.mark.skipif(
    not (ROOT / ".venv/docs/lock.txt").is_file(), reason="`make docs` installs Sphinx"
)
def test_the_site_is_built_without_warnings(tmp_path: Path) -> None:
    environment = os.environ | {"DOCS_BUILD": str(tmp_path)}
    done = subprocess.run(
        [ROOT / "scripts" / "docs"], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    site = tmp_path / "html"
    pages = [page.relative_to(ROOT).with_suffix(".html") for page in (ROOT / "docs").glob("*.md")]
    assert [str(page) for page in pages if not (site / page).is_file()] == []
    python = (site / "docs" / "generated" / "python.html").read_text(encoding="utf-8")
    assert 'id="ator_ros.refinement.step_durations.predict_durations"' in python
    assert "docs/generated/python.html" in (site / "README.html").read_text(encoding="utf-8")
