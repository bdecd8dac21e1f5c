"""Write requirements/constraints.txt: version and hashes of all packages that the pins beside it bring along.

    python3 scripts/lock.py              after changing a pin: everything else keeps its version
    python3 scripts/lock.py --upgrade    the newest versions of what is not pinned

The lock holds for every Python and Linux machine that set-up supports: the hashes are those of all files of a
version. uv works them out, in a temporary virtual environment. It asks the index that UV_DEFAULT_INDEX names.
Needs only the standard library.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

HEADER = "# Written by scripts/lock.py: what the pins beside this file bring along, with hashes.\n"
FOLDER = Path(__file__).resolve().parents[1] / "requirements"
NAMES = ("ros", "build", "runtime", "offline", "view", "test", "lint")
OLDEST_PYTHON = "3.11"


def locked(text: str) -> str:
    """Return what `uv pip compile` wrote without packages for other systems and without its comments."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    entries = re.split(r"\n(?=\w)", "\n".join(lines).strip())
    return "\n".join(entry for entry in entries if "win32" not in entry.split("\n")[0]) + "\n"


def main() -> int:
    """Write the lock; the exit code is uv's."""
    target = FOLDER / "constraints.txt"
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = Path(folder, "bin", "python")
        subprocess.run([python, "-m", "pip", "install", "--quiet", "uv"], check=True)
        result = Path(folder, "lock.txt")
        result.write_bytes(target.read_bytes())  # uv keeps the versions that it finds here
        options = ["--universal", "--python-version", OLDEST_PYTHON, "--generate-hashes", "--no-header"]
        options += ["--no-annotate", "--quiet", "--output-file", str(result), *sys.argv[1:]]
        files = [str(FOLDER / f"{name}.txt") for name in NAMES]
        done = subprocess.run([python, "-m", "uv", "pip", "compile", *options, *files], check=False)
        if done.returncode == 0:
            beside = target.with_name(target.name + ".new")
            beside.write_text(HEADER + locked(result.read_text(encoding="utf-8")), encoding="utf-8")
            beside.replace(target)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
