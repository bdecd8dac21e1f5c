"""pybullet, imported when the first world is made: ``--help`` and most nodes need none."""

from __future__ import annotations

import functools
import importlib
import os
import sys
from pathlib import Path
from typing import Any


class BulletClient:
    """A new world, with the functions and constants of pybullet; `pybullet_utils` has one that prints."""

    def __init__(self) -> None:
        self._pybullet = _imported_without_banner("pybullet")
        self._number = self._pybullet.connect(self._pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        """Return what pybullet has under a name, for this world."""
        found = getattr(self._pybullet, name)
        if callable(found):
            found = functools.partial(found, physicsClientId=self._number)
        setattr(self, name, found)
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
