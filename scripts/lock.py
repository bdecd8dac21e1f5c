"""Write requirements/constraints.txt: the version of every package that pip put into .venv.

After changing a pin: empty the file, `make clean setup`, `scripts/run python scripts/lock.py`.
"""

import importlib.metadata
import re
from pathlib import Path

HEADER = "# Written by scripts/lock.py: every wheel that the pins beside this file bring along.\n"


def main() -> None:
    """Lock what pip installed; ROS's wheels carry inner packages of their own, which pip doesn't know."""
    installed = [d for d in importlib.metadata.distributions() if d.read_text("INSTALLER") == "pip\n"]
    pins = {re.sub(r"[-_.]+", "-", d.metadata["Name"]).lower(): d.version for d in installed}
    del pins["pip"]
    target = Path(__file__).resolve().parents[1] / "requirements" / "constraints.txt"
    target.write_text(HEADER + "".join(f"{n}=={pins[n]}\n" for n in sorted(pins)), encoding="utf-8")


if __name__ == "__main__":
    main()
