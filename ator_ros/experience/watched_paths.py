"""The paths on which a server has driven, by start and goal: routes on a map without its planner.

They are kept in a file, so that models are learned from the paths that the server followed itself,
without requests to its planner, which may be busy with a drive.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from ator_ros.files import DamagedFileError, read_text, write_text
from ator_ros.geometry import FloatArray

PATHS = "paths.jsonl"
"""The file in the folder of the node `watch`."""
_MOST = 5000  # paths that are kept, as many as two weeks of 400 drives
_LARGEST = 64_000_000  # bytes of the file; a path of 15 m needs 2 kB
_STEP = 0.1  # m between the places of a path that are kept: a fifth of the look-ahead of routes
_NEAR = 0.5  # m; servers stop up to 0.25 m from their goals, and pass them as far away
_DIGITS = 3  # of places in m
_Key = tuple[float, float, float, float]


class WatchedPaths:
    """The newest paths of a server, from start to goal, as the planner of a map.

    Parameters
    ----------
    file : Path or None
        JSON lines, one for each path; read now if it exists, and appended to by `save`. None: paths
        are kept in memory only.

    Raises
    ------
    DamagedFileError
        A line of the file is no path.
    OSError
        It cannot be read.
    """

    def __init__(self, file: Path | None = None) -> None:
        self._file = file
        self._paths: dict[_Key, FloatArray] = {}
        self._ends: FloatArray | None = None  # the keys of the paths, once they are searched
        if file is not None and file.exists():
            self._read(file)

    def __str__(self) -> str:
        return "the server, watched"

    def __len__(self) -> int:
        return len(self._paths)

    def __call__(self, start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        """Return the path between two places in m, shape (n, 2), or None if none was watched.

        That of a drive between these places counts, else the newest one between places near them.
        """
        found = self._paths.get(_key(start, goal))
        return self._near(start, goal) if found is None else found

    def newest(self, most: int) -> list[FloatArray]:
        """Return the newest paths, at most `most`, the oldest of them first."""
        return list(self._paths.values())[-most:]

    def _near(self, start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        """Return the newest path that begins and ends within `_NEAR` of two places."""
        if not self._paths:
            return None
        if self._ends is None:
            self._ends = np.array(list(self._paths))
        from_start = np.hypot(*(self._ends[:, :2] - start).T)
        from_goal = np.hypot(*(self._ends[:, 2:] - goal).T)
        near = np.flatnonzero(np.maximum(from_start, from_goal) <= _NEAR)
        if not len(near):
            return None
        x, y, to_x, to_y = self._ends[near[-1]].tolist()
        return self._paths[x, y, to_x, to_y]

    def add(self, start: tuple[float, float], goal: tuple[float, float], path: FloatArray) -> None:
        """Add a path in m, shape (n, 2), from `start` to `goal`, in memory only.

        It has a place every 10 cm then.
        """
        self._keep(_key(start, goal), _thinned(path))

    def save(self, start: tuple[float, float], goal: tuple[float, float], path: FloatArray) -> None:
        """Add a path as `add` does, and write it to the file; raises OSError."""
        key = _key(start, goal)
        self.add(start, goal, path)
        if self._file is None:
            return
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(_line(key, self._paths[key]))
            stream.flush()
            os.fsync(stream.fileno())
        if self._file.stat().st_size > _LARGEST // 2:
            lines = (_line(*item) for item in list(self._paths.items())[-_MOST // 2 :])
            write_text(self._file, "".join(lines))

    def _keep(self, key: _Key, path: FloatArray) -> None:
        self._ends = None
        self._paths.pop(key, None)  # the newest comes last
        self._paths[key] = path
        if len(self._paths) > _MOST:
            del self._paths[next(iter(self._paths))]

    def _read(self, file: Path) -> None:
        lines = read_text(file, _LARGEST).splitlines(keepends=True)
        for number, line in enumerate(lines, start=1):
            if not line.endswith("\n"):
                break  # the process was killed while it wrote
            try:
                content = json.loads(line)
                key = tuple(map(float, content["ends"]))
                path = np.array(content["path"], dtype=float)
                if len(key) != 4 or path.ndim != 2 or path.shape[1] != 2 or len(path) < 2:
                    raise ValueError("it has other numbers")
                if not np.isfinite(path).all():
                    raise ValueError("numbers are not finite")
            except (KeyError, RecursionError, TypeError, ValueError) as error:
                raise DamagedFileError(
                    f"{file}: line {number}: expected a path: {error}"
                ) from error
            self._keep((key[0], key[1], key[2], key[3]), path)


def _key(start: tuple[float, float], goal: tuple[float, float]) -> _Key:
    x, y, to_x, to_y = (round(float(value), _DIGITS) + 0.0 for value in (*start, *goal))
    return x, y, to_x, to_y


def _thinned(path: FloatArray) -> FloatArray:
    """Return places of a path every `_STEP`, and its end; at least two."""
    lengths = np.hypot(*np.diff(path, axis=0).T)
    along = np.append(0.0, np.cumsum(lengths))
    count = max(2, int(along[-1] / _STEP) + 1)
    wanted = np.linspace(0.0, along[-1], count)
    places = np.stack([np.interp(wanted, along, column) for column in path.T], axis=1)
    return np.asarray(np.round(places, _DIGITS))


def _line(key: _Key, path: FloatArray) -> str:
    content = {"ends": key, "path": path.tolist()}
    return json.dumps(content, separators=(",", ":")) + "\n"
