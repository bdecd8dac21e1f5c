"""Simulated robots, objects and sensors."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path


def _import_without_banner(module: str) -> None:
    """Import a module and suppress its output to the process's stderr."""
    try:
        kept = os.dup(2)
    except OSError:  # a process without stderr
        importlib.import_module(module)
        return
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        importlib.import_module(module)
    finally:
        os.dup2(kept, 2)
        os.close(kept)


_import_without_banner("pybullet")
