"""Invalid files: damaged, of another kind, or not regular files."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as parquet

from ator_ros.resources import resource_path

PIONEER = resource_path("config", "pioneer.yaml").read_text(encoding="utf-8")
GATE = resource_path("models", "gate.json").read_text(encoding="utf-8")


def contents() -> dict[str, bytes]:
    """Return invalid contents by name."""
    return {
        "empty": b"",
        "noise": bytes(range(256)) * 40,
        "utf-16": PIONEER.encode("utf-16"),
        "json list": b"[1, 2, 3]",
        "json of another kind": b'{"format": "ator_ros study", "schema_version": 1}',
        "json of the future": GATE.replace('"schema_version": 1', '"schema_version": 99').encode(),
        "a gate": GATE.encode(),
        "yaml unknown fields": (PIONEER + "\ncolor: red\n").encode(),
        "yaml tab": b"robot:\n\tname: x\n",
        "yaml nan": PIONEER.replace("mass: 9.0", "mass: .nan").encode(),
        "yaml object": b"!!python/object/apply:os.system ['true']\n",
        "parquet of another kind": other_table(),
        "mcap cut off": b"\x89MCAP0\r\n\x01\x20",
    }


def other_table() -> bytes:
    """Return a valid Parquet file that is not experience."""
    with io.BytesIO() as file:
        parquet.write_table(pa.table({"price": [1.5, 2.5], "reason": ["a", "b"]}), file)
        return file.getvalue()


def odd_files(folder: Path, suffix: str, wanted: Callable[[str], bool] = lambda _: True) -> list[Path]:
    """Write odd files with a suffix to `folder`; return all paths, including those without a regular file."""
    folder.mkdir(parents=True)
    files = []
    for name, content in contents().items():
        if wanted(name):
            file = folder / f"{name}{suffix}"
            file.write_bytes(content)
            files.append(file)
    unicode_name = folder / f"Größe \u202e世界 \x1b[31m{suffix}"
    unicode_name.write_bytes(b"\x00")
    (folder / f"folder{suffix}").mkdir()
    (folder / f"dangling{suffix}").symlink_to(folder / "nowhere")
    os.mkfifo(folder / f"pipe{suffix}")
    odd = [folder / f"{name}{suffix}" for name in ("missing", "folder", "dangling", "pipe")]
    return [*files, unicode_name, *odd]
