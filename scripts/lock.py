"""Write version and hashes of all packages that the pins in requirements/ bring along.

constraints.txt is for `make setup`, docs-constraints.txt for `make docs`.

    python3 scripts/lock.py              after changing a pin: everything else keeps its version
    python3 scripts/lock.py --upgrade    the newest versions of what is not pinned

The lock holds for every Python and Linux machine that set-up supports: the hashes are those of all
files of a version. uv works them out, in a temporary virtual environment. It asks the index that
UV_DEFAULT_INDEX names. Needs only the standard library.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

HEADER = "# Written by scripts/lock.py: what the pins beside this file bring along, with hashes.\n"
FOLDER = Path(__file__).resolve().parents[1] / "requirements"
LOCKS = {
    "constraints": ("ros", "build", "runtime", "offline", "view", "test", "lint"),
    "docs-constraints": ("docs",),
}
OLDEST_PYTHON = "3.11"


def locked(text: str) -> str:
    """Return what `uv pip compile` wrote, without comments and without packages for Windows."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    entries = re.split(r"\n(?=\w)", "\n".join(lines).strip())
    return "\n".join(entry for entry in entries if "win32" not in entry.split("\n")[0]) + "\n"


def write_lock(uv: list[str], target: Path, names: Sequence[str], *, upgrade: bool) -> int:
    """Write the lock of the pins in the files `names`; the exit code is uv's."""
    result = Path(uv[0]).parent / target.name
    if target.is_file():
        result.write_bytes(target.read_bytes())  # uv keeps the versions that it finds here
    options = ["--universal", "--python-version", OLDEST_PYTHON, "--generate-hashes", "--no-header"]
    options += ["--no-annotate", "--quiet", "--output-file", str(result)]
    options += ["--upgrade"] if upgrade else []
    files = [str(FOLDER / f"{name}.txt") for name in names]
    done = subprocess.run([*uv, "pip", "compile", *options, *files], check=False)
    if done.returncode == 0:
        beside = target.with_name(target.name + ".new")
        beside.write_text(HEADER + locked(result.read_text(encoding="utf-8")), encoding="utf-8")
        beside.replace(target)
    return done.returncode


def main() -> int:
    """Write the locks; the exit code is 0 if uv made all of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--upgrade", action="store_true", help="take the newest versions of what is not pinned"
    )
    upgrade = parser.parse_args().upgrade
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = str(Path(folder, "bin", "python"))
        subprocess.run([python, "-m", "pip", "install", "--quiet", "uv"], check=True)
        uv = [python, "-m", "uv"]
        codes = [
            write_lock(uv, FOLDER / f"{name}.txt", names, upgrade=upgrade)
            for name, names in LOCKS.items()
        ]
        return max(codes)


if __name__ == "__main__":
    sys.exit(main())
