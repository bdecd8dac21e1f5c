"""Maps of buildings: grids of free cells, from files of map_server or OccupancyGrid messages."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import yaml
from numpy.typing import NDArray

from ator_ros.files import FileError, atomic_write, read_yaml, write_text
from ator_ros.geometry import BoolArray, FloatArray, Pose
from ator_ros.printable import printable
from ator_ros.schema import Must, SchemaError, Within, require, structured

if TYPE_CHECKING:
    from PIL import Image

_LARGEST_YAML = 100_000  # bytes; map_server's have 200
_FREE = 25  # percent up to which a cell of an OccupancyGrid is free, as map_saver writes it
_LOCALIZATION = 0.15  # m by which start and goal may be too close to an obstacle, as in routes
_MOST_CELLS = 100_000_000  # 500 x 500 m at 5 cm
# Decoders of images. Pillow has many others, of which some start programs.
_FORMATS = ("PPM", "PNG", "BMP")  # PPM includes PGM and PBM
_TRANSPARENT = ("LA", "PA", "RGBA")  # Pillow's modes of images with an alpha channel

Planner = Callable[[tuple[float, float], tuple[float, float]], FloatArray | None]
"""Returns a path between two places, shape (n, 2), in m, or None. Its text names the planner.

It may raise PlannerBusyError."""


class PlannerBusyError(Exception):
    """The planner must not be asked now: routes are searched on the map instead."""


@dataclass(frozen=True)
class _MapFile:
    """The fields of a map_server file that are used here."""

    image: str
    resolution: Annotated[float, Within(0.001, 10.0)]  # m
    origin: Annotated[
        tuple[float, ...], Must("x, y (m) and yaw (rad)", lambda origin: len(origin) == 3)
    ]
    free_thresh: Annotated[float, Within(0.0, 1.0)]
    occupied_thresh: Annotated[float, Within(0.0, 1.0)]
    negate: int | bool = 0
    mode: Annotated[str, Must("trinary", lambda mode: mode.lower() == "trinary")] = "trinary"

    def __post_init__(self) -> None:
        """Raise SchemaError if a cell could be both free and occupied."""
        expected = f"a number of at most occupied_thresh {self.occupied_thresh:g}"
        require(self.free_thresh <= self.occupied_thresh, "free_thresh", expected, self.free_thresh)


PATHS_OF = ", paths of "
"""Precedes the name of the planner in the text of a map, see `GridMap.__str__`."""


@dataclass(frozen=True, eq=False)
class GridMap:
    """A grid of cells: free, or else occupied or unknown.

    Maps are equal if name and content are.
    """

    name: str  # file or topic, for messages
    free: BoolArray  # shape (rows, columns), the first row at the origin
    resolution: float  # m; side of a cell
    origin: Pose  # outer corner of the first cell, and the direction of its row
    planner: Planner | None = None  # plans the routes of drives, instead of `Routes`

    def __post_init__(self) -> None:
        """Raise FileError if the map is not plausible."""
        numbers = (self.resolution, *self.origin)
        if not all(map(math.isfinite, numbers)) or not 0.001 <= self.resolution <= 10.0:
            raise FileError(
                f"{self.name}: expected a finite origin and cells of 0.001 to 10 m, got {numbers}"
            )
        if not self.free.any():
            raise FileError(
                f"{self.name}: expected free cells, got none: check negate and free_thresh"
            )

    @cached_property
    def _text(self) -> str:
        # Origins in messages are rounded: their yaw is that of a quaternion.
        numbers = np.round([*self.free.shape, self.resolution, *self.origin], 6) + 0.0
        digest = hashlib.sha256(numbers.tobytes() + self.free.tobytes()).hexdigest()[:8]
        return (
            f"{self.name} ({digest}{'' if self.planner is None else f'{PATHS_OF}{self.planner}'})"
        )

    def __str__(self) -> str:
        """Return the name, a digest of the content, and the name of a planner."""
        return self._text

    def __eq__(self, other: object) -> bool:
        return isinstance(other, GridMap) and self._text == other._text

    def __hash__(self) -> int:
        return hash(self._text)

    def cells(self, x: Any, y: Any) -> tuple[FloatArray, FloatArray]:
        """Return places in m as cells from the origin, along its row and across, elementwise."""
        cos = math.cos(self.origin.yaw)
        sin = math.sin(self.origin.yaw)
        dx = np.asarray(x) - self.origin.x
        dy = np.asarray(y) - self.origin.y
        return (cos * dx + sin * dy) / self.resolution, (cos * dy - sin * dx) / self.resolution

    def is_free(self, x: Any, y: Any) -> BoolArray:
        """Return whether places in m are in free cells, elementwise; False beyond the map."""
        along, across = (np.floor(cells).astype(int) for cells in self.cells(x, y))
        rows, columns = self.free.shape
        inside = (across >= 0) & (across < rows) & (along >= 0) & (along < columns)
        found: BoolArray = inside & self.free[across * inside, along * inside]
        return found

    def obstacle_on(self, poses: FloatArray, half_width: float) -> tuple[float, float] | None:
        """Return the first place in m at which a robot's axle would be in an obstacle, or None.

        Parameters
        ----------
        poses : FloatArray
            The poses of the axle's middle, shape (n, 3), in m and continuous rad.
        half_width : float
            Half of the robot's width in m. A cell less is checked, so that doors as wide as the
            robot are open, and nothing 0.15 m around both ends: localization errs.
        """
        longest = np.hypot(*np.diff(poses[:, :2], axis=0).T).max(initial=0.0)
        parts = math.ceil(2.0 * longest / self.resolution) or 1  # at most half a cell each
        index = np.linspace(0.0, len(poses) - 1, parts * (len(poses) - 1) + 1)
        poses = np.stack([np.interp(index, range(len(poses)), each) for each in poses.T], axis=1)
        to_ends = np.hypot(*(poses[:, None, :2] - poses[None, [0, -1], :2]).T).min(axis=0)
        checked = poses[to_ends > _LOCALIZATION]
        most = max(half_width - self.resolution, 0.0)
        sideways = np.linspace(-most, most, 1 + 2 * math.ceil(most / self.resolution))
        x = checked[:, :1] - sideways * np.sin(checked[:, 2:])
        y = checked[:, 1:2] + sideways * np.cos(checked[:, 2:])
        blocked = np.argwhere(~self.is_free(x, y))
        if not len(blocked):
            return None
        first = tuple(blocked[0])
        return float(x[first]), float(y[first])

    @cached_property
    def walls(self) -> list[tuple[Pose, float, float]]:
        """Rectangles that cover all obstacles next to free cells: middle, length, width (m)."""
        from scipy import ndimage  # slow to import, and needed with a map only

        free = np.pad(self.free, 2)
        edges = np.diff((ndimage.binary_dilation(free, np.ones((3, 3))) & ~free).astype(np.int8))
        found = []
        begun = dict[tuple[int, int], int]()
        for row, steps in enumerate(edges):
            runs = list(
                zip(*(np.flatnonzero(steps == sign).tolist() for sign in (1, -1)), strict=True)
            )
            ended = [run for run in begun if run not in runs]
            found += [(*run, begun.pop(run), row) for run in ended]
            begun |= {run: row for run in runs if run not in begun}
        side = self.resolution
        walls = []
        for left, right, low, high in found:
            middle = Pose(0.5 * side * (left + right - 2), 0.5 * side * (low + high - 4), 0.0)
            walls.append((self.origin.compose(middle), side * (right - left), side * (high - low)))
        return walls


def map_of_grid(
    name: str,
    width: int,
    height: int,
    resolution: float,
    origin: Pose,
    data: Sequence[int],
) -> GridMap:
    """Return the map of an OccupancyGrid, whose `data` are row by row percent, or -1 where unknown.

    Raises FileError if `data` has another size, or no cell is free.
    """
    values = np.asarray(data, dtype=np.int16)
    if values.size != width * height or not 0 < values.size <= _MOST_CELLS:
        raise FileError(
            f"{name}: expected {width} x {height} cells, at most 1e8, got {values.size}"
        )
    free = (values >= 0) & (values <= _FREE)
    # the decimal that the map's file has, not the nearest float32
    side = float(str(np.float32(resolution)))
    return GridMap(name, free.reshape(height, width), side, origin)


def describe_values(data: Sequence[int]) -> str:
    """Return a text: which values the cells of an OccupancyGrid have, and which are free."""
    values = np.asarray(data, dtype=np.int16)
    if not values.size:
        return "it has no cells"
    return f"its cells have values from {values.min()} to {values.max()}, free are 0 to {_FREE}"


def load_map(path: Path | str) -> GridMap:
    """Read the map that a YAML file of map_server describes.

    Raises FileError, which names file and field, if the file or its image cannot be used.
    """
    file = Path(path)
    try:
        data = read_yaml(file, largest=_LARGEST_YAML)
        if isinstance(data, dict):  # map_server ignores unknown fields, too
            data = {item.name: data[item.name] for item in fields(_MapFile) if item.name in data}
        read = structured(data, _MapFile)
    except SchemaError as error:
        raise FileError(f"{printable(file, 200)}: expected a map_server file: {error}") from error
    return GridMap(
        printable(file.name),
        _free_pixels(file.parent / read.image, read)[::-1],
        read.resolution,
        Pose(*read.origin),
    )


def save_map(grid: GridMap, folder: Path) -> Path:
    """Write a map as the files map.yaml and map.pgm of map_server; return the former."""
    rows, columns = grid.free.shape
    shades = np.where(grid.free, 254, 0).astype(np.uint8)[::-1]
    with atomic_write(folder / "map.pgm") as temporary:
        temporary.write_bytes(f"P5 {columns} {rows} 255\n".encode() + shades.tobytes())
    content = {
        "image": "map.pgm",
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "negate": 0,
    }
    content |= {"occupied_thresh": 0.65, "free_thresh": 0.25}
    write_text(folder / "map.yaml", yaml.safe_dump(content))
    return folder / "map.yaml"


def _free_pixels(file: Path, read: _MapFile) -> BoolArray:
    """Return which pixels of an image are free, shape (height, width): bright ones by default.

    The brightness of a color is the mean of its channels, as in map_server. Pixels that are not
    opaque are unknown.
    """
    from PIL import Image  # slow to import, and needed with a map only

    shown = printable(file, 120)
    try:
        if not file.is_file():  # opening a pipe would block
            raise FileError(
                f"{shown}: expected the image of a map, there is none: check the field image"
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow, whose limit is similar to ours
            with Image.open(file, formats=_FORMATS) as image:
                if image.width * image.height > _MOST_CELLS:
                    got = f"{image.width} x {image.height}"
                    raise ValueError(f"expected at most 1e8 pixels, got {got}")
                values, most = _brightness(image)
                opaque = _opaque(image, values, file)
    except FileError:
        raise
    except Exception as error:  # Pillow raises many on damaged files
        raise FileError(
            f"{shown}: expected a readable PGM or PNG, or a BMP: {printable(error, 70)}"
        ) from error
    occupied = np.arange(most + 1) / most
    if not read.negate:
        occupied = 1.0 - occupied
    free: BoolArray = (occupied < read.free_thresh)[np.clip(values, 0, most)]
    return free if opaque is None else free & opaque


def _brightness(image: Image.Image) -> tuple[NDArray[Any], int]:
    """Return the brightness of each pixel of an image, and the greatest possible one."""
    if image.mode.startswith("I"):  # 16 bit
        return np.asarray(image), 65535
    if image.mode in ("1", "L", "LA"):
        return np.asarray(image.convert("L")), 255
    colored = image.convert("RGB")
    total = np.zeros((image.height, image.width), dtype=np.uint16)
    for channel in ("R", "G", "B"):
        total += np.asarray(colored.getchannel(channel))
    return total, 3 * 255


def _opaque(
    image: Image.Image,
    values: NDArray[Any],
    file: Path,
) -> BoolArray | None:
    """Return which pixels of an image of some brightness are opaque; None if all are."""
    transparent = image.info.get("transparency")
    if image.mode in _TRANSPARENT or (image.mode == "P" and transparent is not None):
        opaque: BoolArray = np.asarray(image.convert("RGBA").getchannel("A")) == 255
        return opaque
    if transparent is None:
        return None
    # It is a sample of the file, which Pillow scales to 8 bit; gray ones of 16 bit it keeps.
    with file.open("rb") as stream:
        bits = stream.read(25)[24]
    if isinstance(transparent, tuple):
        pixels = np.asarray(image)
        matches = [
            pixels[..., index] == sample >> (bits - 8) for index, sample in enumerate(transparent)
        ]
        opaque = ~np.all(matches, axis=0)
    else:
        sample = transparent % 2**bits
        opaque = values != (sample if bits >= 8 else sample * 255 // (2**bits - 1))
    return opaque
