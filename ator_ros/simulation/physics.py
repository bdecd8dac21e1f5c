"""pybullet, imported when the first of its functions is used: ``--help`` and most nodes need none."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from typing import Any


def __getattr__(name: str) -> Any:
    """Return what pybullet has under a name, which is looked up here from then on."""
    found = getattr(_imported_without_banner("pybullet"), name)
    globals()[name] = found
    return found


def _imported_without_banner(module: str) -> Any:
    """Import a module and suppress its output to the process's stderr."""
    try:
        kept = os.dup(2)
    except OSError:  # a process without stderr
        return importlib.import_module(module)
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        return importlib.import_module(module)
    finally:
        os.dup2(kept, 2)
        os.close(kept)
