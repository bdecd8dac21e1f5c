"""Maps from files of map_server."""

import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maps import hall, write_map
from PIL import Image

from ator_ros.files import FileError
from ator_ros.geometry import Pose
from ator_ros.world.grid_map import GridMap, describe_values, load_map, map_of_grid, save_map

SHADES = np.array(
    [[254, 205, 0], [254, 254, 100]], dtype=np.uint8
)  # free, unknown, occupied; the top row first
FREE = [[True, True, False], [True, False, False]]


def test_a_map_is_read_from_its_lowest_row_on(tmp_path: Path) -> None:
    read = load_map(write_map(tmp_path, hall()))
    assert (read.free == hall()).all()
    assert (read.name, read.resolution, read.origin) == ("hall.yaml", 0.05, Pose(-6.0, -4.0, 0.0))
    assert str(read) == str(load_map(write_map(tmp_path, hall())))
    assert str(read) != str(load_map(write_map(tmp_path, hall(wall=False))))


@pytest.mark.parametrize("kind", ["png", "plain", "negated", "deep"])
def test_images_of_all_kinds_are_read(tmp_path: Path, kind: str) -> None:
    file = write_map(
        tmp_path, hall(), image="other.png", free_thresh=0.19, negate=int(kind == "negated")
    )
    shades = 255 - SHADES if kind == "negated" else SHADES
    if kind == "plain":
        (tmp_path / "other.png").write_text(f"P2 3 2 255 {' '.join(map(str, shades.ravel()))}")
    else:
        deep = shades.astype(np.uint16) * 257
        Image.fromarray(deep if kind == "deep" else shades).save(tmp_path / "other.png")
    assert load_map(file).free.tolist() == FREE


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (
            {"mode": "raw"},
            r"hall\.yaml: expected a map_server file: mode: expected trinary; got 'raw'",
        ),
        ({"resolution": 0.0}, "resolution: expected a number from 0.001 to 10; got 0"),
        ({"origin": [0.0, 0.0]}, "origin: expected x, y"),
        ({"image": "none.pgm"}, r"none\.pgm: expected the image of a map, there is none"),
        ({"image": "hall.yaml"}, r"hall\.yaml: expected a readable PGM or PNG"),
        ({"free_thresh": 0.0}, "expected free cells, got none"),
        (
            {"free_thresh": 0.7},
            "free_thresh: expected a number of at most occupied_thresh 0.65; got 0.7",
        ),
        ({"image": "x" * 5000}, r"x{20,}… \(\d+ characters\): expected a readable PGM or PNG"),
    ],
)
def test_an_unusable_map_is_rejected_with_the_reason(
    tmp_path: Path, fields: dict[str, Any], text: str
) -> None:
    with pytest.raises(FileError, match=text):
        load_map(write_map(tmp_path, hall(), **fields))


@pytest.mark.parametrize("mode", ["LA", "RGBA", "P", "L"])
def test_pixels_that_are_not_opaque_are_unknown(tmp_path: Path, mode: str) -> None:
    image = Image.fromarray(np.array([[254, 253, 254]], dtype=np.uint8))
    if mode in ("LA", "RGBA"):
        image.putalpha(Image.fromarray(np.array([[255, 0, 254]], dtype=np.uint8)))
        image.convert(mode).save(tmp_path / "other.png")
    else:
        color = 253 if mode == "L" else image.convert("P").getpixel((1, 0))
        image.convert(mode).save(tmp_path / "other.png", transparency=color)
    read = load_map(write_map(tmp_path, hall(), image="other.png"))
    assert read.free.tolist() == [[True, False, mode not in ("LA", "RGBA")]]


def png(bits: int, color: int, row: bytes, *others: tuple[bytes, bytes]) -> bytes:
    """Return a PNG file with a row of three pixels; color 0 is gray, 2 RGB and 3 a palette."""
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", 3, 1, bits, color, 0, 0, 0)),
        *others,
        (b"IDAT", zlib.compress(b"\0" + row)),
        (b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )


@pytest.mark.parametrize(
    ("bits", "row", "sample"),
    [
        (1, b"\x60", 1),
        (2, b"\x3c", 3),
        (4, b"\x0f\xe0", 15),
        (8, b"\x00\xff\xfe", 255),
        (16, struct.pack(">HHH", 0, 0xFE00, 0xFF00), 0xFE00),
    ],
)
def test_the_transparent_gray_is_a_sample_before_scaling(
    tmp_path: Path, bits: int, row: bytes, sample: int
) -> None:
    file = write_map(tmp_path, hall(), image="other.png")
    (tmp_path / "other.png").write_bytes(png(bits, 0, row))
    assert load_map(file).free.tolist() == [[False, True, True]]
    transparent = b"tRNS", struct.pack(">H", sample)
    (tmp_path / "other.png").write_bytes(png(bits, 0, row, transparent))
    if bits > 2:
        assert load_map(file).free.tolist() == [[False, False, True]]
    else:
        with pytest.raises(FileError, match="expected free cells, got none"):
            load_map(file)


def test_the_brightness_of_a_color_is_the_mean_of_its_channels(tmp_path: Path) -> None:
    file = write_map(tmp_path, hall(), image="other.png")
    yellow, pink, blue = b"\xff\xff\x00", b"\xff\xc8\xc8", b"\xc8\xc8\xff"
    (tmp_path / "other.png").write_bytes(png(8, 2, yellow + pink + blue))
    assert load_map(file).free.tolist() == [[False, True, True]]
    transparent = b"tRNS", struct.pack(">HHH", 0xFF, 0xC8, 0xC8)
    (tmp_path / "other.png").write_bytes(png(8, 2, yellow + pink + blue, transparent))
    assert load_map(file).free.tolist() == [[False, False, True]]
    palette = b"PLTE", yellow + pink + blue
    (tmp_path / "other.png").write_bytes(png(8, 3, b"\0\1\2", palette))
    assert load_map(file).free.tolist() == [[False, True, True]]


def test_a_transparent_palette_is_read_without_a_warning(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    file = write_map(tmp_path, hall(), image="other.png")
    parts = (b"PLTE", b"\xfe" * 9), (b"tRNS", b"\xff\x80\xff")
    (tmp_path / "other.png").write_bytes(png(8, 3, b"\0\1\2", *parts))
    assert load_map(file).free.tolist() == [[True, False, True]]
    assert not list(recwarn)


@pytest.mark.parametrize(("text", "number"), [("5e-2", 0.05), ("1.e-1", 0.1), ("+.5E0", 0.5)])
def test_numbers_are_those_of_yaml_1_2(tmp_path: Path, text: str, number: float) -> None:
    file = write_map(tmp_path, hall())
    content = file.read_text().replace("resolution: 0.05", f"resolution: {text}")
    file.write_text(content)
    assert load_map(file).resolution == number


@pytest.mark.parametrize("text", [f"0x{'f' * 5000}", "1" + ":1" * 3000], ids=["hex", "base 60"])
def test_a_number_of_too_many_digits_is_rejected(tmp_path: Path, text: str) -> None:
    file = write_map(tmp_path, hall())
    file.write_text(file.read_text().replace("resolution: 0.05", f"resolution: {text}"))
    with pytest.raises(FileError, match=r"line \d: expected a number of at most 100 characters"):
        load_map(file)


def test_only_images_that_map_server_writes_are_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = tmp_path / "started"
    program = tmp_path / "gs"
    program.write_text(f"#!/bin/sh\ntouch {started}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    file = write_map(tmp_path, hall())
    (tmp_path / "hall.pgm").write_text(
        "%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\nshowpage\n"
    )
    with pytest.raises(FileError, match="expected a readable PGM or PNG"):
        load_map(file)
    assert not started.exists()


@pytest.mark.parametrize("header", [b"P5 131072 131072 255\n", b"P4 10001 10001\n"])
def test_pixels_are_counted_before_they_are_decoded(tmp_path: Path, header: bytes) -> None:
    file = write_map(tmp_path, hall())
    (tmp_path / "hall.pgm").write_bytes(header + bytes(12_000))
    with pytest.raises(FileError, match=r"hall\.pgm: expected a readable PGM or PNG.*pixels"):
        load_map(file)


def test_a_grid_of_another_size_is_rejected() -> None:
    with pytest.raises(FileError, match=r"/map: expected 3 x 2 cells, at most 1e8, got 5"):
        map_of_grid("/map", 3, 2, 0.1, Pose(0.0, 0.0, 0.0), [0] * 5)


@pytest.mark.parametrize("resolution", [1e-30, 1e30, -0.05, float("nan")])
def test_a_grid_of_cells_of_no_usual_size_is_rejected(resolution: float) -> None:
    with pytest.raises(
        FileError, match=r"/map: expected a finite origin and cells of 0\.001 to 10 m"
    ):
        map_of_grid("/map", 1, 1, resolution, Pose(0.0, 0.0, 0.0), [0])


def test_walls_cover_the_obstacles_beside_free_cells() -> None:
    frame = Pose(1.0, 2.0, 0.5)
    grid = GridMap("hall", hall(), 0.05, frame)
    covered = np.zeros((164, 244), dtype=int)
    for middle, length, width in grid.walls:
        x, y = grid.cells(middle.x, middle.y)
        assert middle.yaw == pytest.approx(0.5)
        left, low = round(x - 10.0 * length) + 2, round(y - 10.0 * width) + 2
        covered[low : low + round(20.0 * width), left : left + round(20.0 * length)] += 1
    assert covered.max() == 1
    free = np.pad(hall(), 2)
    beside = [np.roll(free, (down, right), (0, 1)) for down in (-1, 0, 1) for right in (-1, 0, 1)]
    assert (covered.astype(bool) == (np.any(beside, axis=0) & ~free)).all()
    assert len(grid.walls) < 15


ORIGIN = Pose(1.0, -2.0, 0.5)


@settings(max_examples=30)
@given(st.floats(0.0, 6.0), st.floats(0.0, 4.0))
def test_places_are_counted_in_cells_along_the_rows(along: float, across: float) -> None:
    grid = GridMap("hall", hall(), 0.05, ORIGIN)
    place = ORIGIN.compose(Pose(along, across, 0.0))
    x, y = grid.cells(place.x, place.y)
    assert (float(x), float(y)) == pytest.approx((along / 0.05, across / 0.05), abs=1e-9)


def test_maps_are_equal_if_name_content_and_planner_are() -> None:
    def planner(start: tuple[float, float], goal: tuple[float, float]) -> None:
        return None

    grid = GridMap("hall", hall(), 0.05, ORIGIN)
    assert grid == GridMap("hall", hall(), 0.05, ORIGIN._replace(x=1.0 + 1e-9))
    assert hash(grid) == hash(GridMap("hall", hall(), 0.05, ORIGIN))
    assert grid != "hall"
    flat = GridMap("hall", hall(), 0.05, Pose(0.0, 0.0, 0.0))
    assert flat == GridMap("hall", hall(), 0.05, Pose(-1e-9, 0.0, -1e-9))
    others = [
        GridMap("room", hall(), 0.05, ORIGIN),
        GridMap("hall", hall(wall=False), 0.05, ORIGIN),
        GridMap("hall", hall(), 0.1, ORIGIN),
        GridMap("hall", hall(), 0.05, ORIGIN._replace(yaw=0.6)),
        GridMap("hall", hall().reshape(240, 160), 0.05, ORIGIN),
        GridMap("hall", hall(), 0.05, ORIGIN, planner),
    ]
    assert all(grid != other for other in others)
    assert str(others[-1]) == f"{str(grid)[:-1]}, paths of {planner})"


def test_cells_of_up_to_a_quarter_are_free() -> None:
    data = [0, 25, 26, 100, -1, 24]
    grid = map_of_grid("/map", 3, 2, np.float32(0.05), ORIGIN, data)
    assert grid.free.tolist() == [[True, True, False], [False, False, True]]
    assert (grid.name, grid.resolution, grid.origin) == ("/map", 0.05, ORIGIN)
    assert describe_values(data) == "its cells have values from -1 to 100, free are 0 to 25"
    assert describe_values([]) == "it has no cells"


@pytest.mark.parametrize(
    ("resolution", "is_right"), [(0.001, True), (10.0, True), (0.0009, False), (10.1, False)]
)
def test_cells_have_a_millimeter_to_ten_meters(resolution: float, is_right: bool) -> None:
    if is_right:
        GridMap("hall", hall(), resolution, ORIGIN)
    else:
        with pytest.raises(FileError, match=r"cells of 0.001 to 10 m"):
            GridMap("hall", hall(), resolution, ORIGIN)


def test_a_map_that_is_saved_is_read_again(tmp_path: Path) -> None:
    grid = GridMap("map.yaml", hall(), 0.05, ORIGIN)
    file = save_map(grid, tmp_path)
    assert file == tmp_path / "map.yaml"
    assert load_map(file) == grid


@pytest.mark.parametrize("image", ["gray", "deep", "color"])
@pytest.mark.parametrize("negate", [0, 1])
def test_a_pixel_is_free_if_it_is_brighter_than_the_threshold(
    tmp_path: Path, image: str, negate: int
) -> None:
    bright = np.array([[255, 204, 203, 0]], dtype=np.uint8)  # occupied by 0, 0.2, 0.204 and 1
    shades = 255 - bright if negate else bright
    pixels: Any = {
        "gray": shades,
        "deep": shades.astype(np.uint16) * 257,
        "color": np.stack([shades] * 3, axis=-1),
    }[image]
    Image.fromarray(pixels).save(tmp_path / "other.png")
    file = write_map(tmp_path, hall(), image="other.png", free_thresh=0.201, negate=negate)
    assert load_map(file).free.tolist() == [[True, True, False, False]]


def test_walls_have_the_frame_and_the_size_of_their_cells() -> None:
    free = np.ones((4, 5), dtype=bool)
    free[1, 1:3] = False
    grid = GridMap("hall", free, 0.5, Pose(10.0, 20.0, 0.0))
    walls = [wall for wall in grid.walls if wall[0].x > 10.0 and 20.0 < wall[0].y < 22.0]
    walls = [wall for wall in walls if wall[0].x < 12.5]
    ((middle, length, width),) = walls
    assert middle == pytest.approx(Pose(11.0, 20.75, 0.0))
    assert (length, width) == (1.0, 0.5)


def straight(start: Pose, length: float) -> np.ndarray:
    """Return poses 1 cm apart on a straight line, shape (n, 3)."""
    return np.array([start.ahead(ahead) for ahead in np.arange(0.0, length, 0.01)])


@pytest.mark.parametrize("yaw", [0.0, 0.4, 0.785, -0.7])
@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("offset", [0.0, 0.3, 0.7])
def test_a_wall_of_one_cell_is_on_every_line_through_it(
    yaw: float, resolution: float, offset: float
) -> None:
    free = np.ones((60, 60), dtype=bool)
    free[:, 30] = False
    grid = GridMap("map", free, resolution, Pose(0.0, 0.0, 0.2))
    start = grid.origin.compose(Pose((29.0 - offset) * resolution - 1.0, 30 * resolution, yaw))
    found = grid.obstacle_on(straight(start, 3.0), 0.17)
    assert found is not None
    assert math.floor(grid.cells(*found)[0]) == 30
    assert grid.obstacle_on(straight(start, 3.0)[::80], 0.17) is not None  # a fast robot
    assert grid.obstacle_on(straight(start, 0.5), 0.17) is None
    assert grid.obstacle_on(straight(start, 9.0 * 60 * resolution), 0.0) is not None  # the edge


def test_a_door_as_wide_as_the_robot_is_open_and_a_narrower_one_is_not() -> None:
    free = np.ones((100, 100), dtype=bool)
    free[:, 50] = False
    free[46:54, 50] = True  # 0.4 m
    grid = GridMap("map", free, 0.05, Pose(0.0, 0.0, 0.0))
    through = straight(Pose(1.0, 2.5, 0.0), 3.0)
    assert grid.obstacle_on(through, 0.2) is None
    assert grid.obstacle_on(through, 0.3) is not None
    assert grid.obstacle_on(straight(Pose(2.45, 3.0, 0.0), 0.2), 0.2) is None  # around its ends
