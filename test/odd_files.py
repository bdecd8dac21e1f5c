"""Files that are not what they are taken for, as users have them: damaged, of another kind, or no files."""

from __future__ import annotations

import io
import os
import sqlite3
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as parquet
from experience_rows import made_up_experience

from ator_ros.experience.table import Experience, write_experience
from ator_ros.resources import resource_path

PIONEER = resource_path("config", "pioneer.yaml").read_text(encoding="utf-8")
TOUR = resource_path("config", "tour", "tour.yaml").read_text(encoding="utf-8")
GATE = resource_path("models", "gate.json").read_text(encoding="utf-8")
MODEL = resource_path("models", "goToPose.json").read_text(encoding="utf-8")


def contents() -> dict[str, bytes]:
    """Return contents that no file should have, by name."""
    return {
        "empty": b"",
        "noise": bytes(range(256)) * 40,
        "zeros": bytes(10_000),
        "text": "Grüße, 世界\n".encode(),
        "latin-1": "größer: 1\n".encode("latin-1"),
        "utf-16": PIONEER.encode("utf-16"),
        "json list": b"[1, 2, 3]",
        "json null": b"null",
        "json of another kind": b'{"format": "ator_ros study", "schema_version": 1}',
        "json of the future": GATE.replace('"schema_version": 1', '"schema_version": 99').encode(),
        "json NaN": b'{"format": NaN, "schema_version": Infinity}',
        "json deep": b"[" * 50_000,
        "a gate": GATE.encode(),
        "yaml list": b"- 1\n- {a: b}\n",
        "yaml number": b"1e999\n",
        "yaml unknown fields": (PIONEER + "\ncolour: red\n").encode(),
        "yaml anchors": b"robot: &r {v: 1}\nscene: *r\n",
        "yaml tab": b"robot:\n\tname: x\n",
        "yaml twice": b"robot: 1\nrobot: 2\n",
        "yaml huge": PIONEER.replace("mass: 9.0", "mass: 1.0e+400").encode(),
        "yaml nan": PIONEER.replace("mass: 9.0", "mass: .nan").encode(),
        "yaml object": b"!!python/object/apply:os.system ['true']\n",
        "yaml null": PIONEER.replace("mass: 9.0", "mass: null").encode(),
        "a domain": TOUR.encode(),
        "parquet of another kind": other_table(),
        "a table without reason": without("reason"),
        "a table without yaw": without("yaw"),
        "a table of lists": with_column("x", pa.array([[1.0]] * 5)),
        "a table with numbers as reason": with_column("reason", pa.array([1] * 5)),
        "a table with texts as numbers": with_column("duration", pa.array(["1"] * 5)),
        "a table with NaN": with_column("duration", pa.array([float("nan")] * 5)),
        "a table without rows": without("", rows=0),
        "parquet cut off": without("")[:-40],
        "mcap cut off": b"\x89MCAP0\r\n\x01\x20",
        "mcap magic": b"\x89MCAP0\r\n" * 2,
        "a zip": zipped(),
        "a png": b"\x89PNG\r\n\x1a\n" + bytes(100),
        "sqlite": database(),
    }


def table() -> pa.Table:
    """Return a small table as `collect` writes them."""
    with io.BytesIO() as file:
        rows = made_up_experience("goToPose", episodes=5)
        path = Path(os.environ.get("TMPDIR", "/tmp")) / f"odd-{os.getpid()}.parquet"  # noqa: S108
        write_experience(path, Experience(rows, {}))
        file.write(path.read_bytes())
        path.unlink()
        return parquet.read_table(io.BytesIO(file.getvalue()))


def written(data: pa.Table) -> bytes:
    """Return a table as the bytes of a Parquet file."""
    with io.BytesIO() as file:
        parquet.write_table(data, file)
        return file.getvalue()


def other_table() -> bytes:
    """Return a valid Parquet file that is no experience."""
    return written(pa.table({"price": [1.5, 2.5], "reason": ["a", "b"]}))


def without(name: str, rows: int = 5) -> bytes:
    """Return a table of experience without a column."""
    data = table().slice(0, rows)
    return written(data.drop_columns([name]) if name else data)


def with_column(name: str, values: pa.Array) -> bytes:
    """Return a table of experience with other values in a column."""
    data = table()
    return written(data.set_column(data.column_names.index(name), name, values))


def zipped() -> bytes:
    """Return a zip archive."""
    with io.BytesIO() as file:
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("model.json", MODEL)
        return file.getvalue()


def database() -> bytes:
    """Return an SQLite database such as older recordings are."""
    with sqlite3.connect(":memory:") as opened:
        opened.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT)")
        return opened.serialize()


def odd_places(folder: Path, suffix: str) -> Iterator[Path]:
    """Yield paths that hold no ordinary file: missing, folders, links that lead nowhere, pipes, devices."""
    yield folder / f"missing{suffix}"
    yield folder / "missing" / f"folder{suffix}"
    yield folder / f"{'long' * 70}{suffix}"
    (folder / f"folder{suffix}").mkdir()
    yield folder / f"folder{suffix}"
    (folder / f"dangling{suffix}").symlink_to(folder / "nowhere")
    yield folder / f"dangling{suffix}"
    (folder / f"loop{suffix}").symlink_to(folder / f"loop{suffix}")
    yield folder / f"loop{suffix}"
    os.mkfifo(folder / f"pipe{suffix}")
    yield folder / f"pipe{suffix}"
    (folder / f"zero{suffix}").symlink_to("/dev/zero")
    yield folder / f"zero{suffix}"
    if os.geteuid() != 0:
        (folder / f"closed{suffix}").write_bytes(b"")
        (folder / f"closed{suffix}").chmod(0)
        yield folder / f"closed{suffix}"


def odd_files(folder: Path, suffix: str, wanted: Callable[[str], bool] = lambda _: True) -> list[Path]:
    """Write odd files with a suffix to `folder`; return the paths, those that hold no file among them."""
    folder.mkdir(parents=True)
    files = []
    for name, content in contents().items():
        if wanted(name):
            file = folder / f"{name}{suffix}"
            file.write_bytes(content)
            files.append(file)
    unicode_name = folder / f"Größe \u202e世界 \x1b[31m{suffix}"
    unicode_name.write_bytes(b"\x00")
    return [*files, unicode_name, *odd_places(folder, suffix)]
