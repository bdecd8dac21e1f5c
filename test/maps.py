"""Small maps for tests, written as map_server files."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ator_ros.geometry import BoolArray, Pose
from ator_ros.world.grid_map import GridMap

FIELDS = {"resolution": 0.05, "origin": [-6.0, -4.0, 0.0], "negate": 0, "free_thresh": 0.25}


def hall(*, wall: bool = True) -> BoolArray:
    """Return the free cells of a hall of 12 x 8 m.

    Its wall at x = 0 has a door from y = 2 to 3.2 m.
    """
    free = np.ones((160, 240), dtype=bool)
    if wall:
        free[:, 118:122] = False
        free[120:144, 118:122] = True
    return free


def hall_map(name: str = "hall", *, wall: bool = True) -> GridMap:
    """Return the map of the hall."""
    return GridMap(name, hall(wall=wall), 0.05, Pose(-6.0, -4.0, 0.0))


def write_map(folder: Path, free: BoolArray, name: str = "hall", **fields: Any) -> Path:
    """Write free cells, the first row at the origin, as NAME.yaml and NAME.pgm.

    Return the former.
    """
    shade = np.where(free, 254, 0).astype(np.uint8)[::-1]
    header = f"P5\n# made by a test\n{free.shape[1]} {free.shape[0]}\n255\n".encode()
    (folder / f"{name}.pgm").write_bytes(header + shade.tobytes())
    content = {"image": f"{name}.pgm", "occupied_thresh": 0.65, **FIELDS, **fields}
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file
