"""Machine code on disk: whatever has become of the files, the function runs and one line says so."""

from __future__ import annotations

import hashlib
import importlib
import os
import pickle
import resource
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ator_ros import compile_cache
from ator_ros.compiled import compiled

pytest.importorskip("numba")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Yield the folder that machine code is kept in during the test."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(compile_cache, "_told", [])
    compile_cache._key.cache_clear()
    yield tmp_path / "cache"
    compile_cache._key.cache_clear()


def hypotenuse(a: float, b: float) -> float:
    return (a * a + b * b) ** 0.5


def run() -> int:
    """Compute in a dispatcher of its own, as a new process would; say how often it found code on disk."""
    function: Any = compiled(hypotenuse)
    assert function(3.0, 4.0) == 5.0
    return sum(function.dispatcher.stats.cache_hits.values())


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.bin"))


def test_what_was_compiled_is_found_again(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert [run(), run()] == [0, 1]
    assert len(files(folder)) == 1
    assert not caplog.records


def test_code_of_another_package_is_compiled_anew_when_any_of_its_files_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "elsewhere"
    package.mkdir()
    (package / "__init__.py").touch()
    source = "from ator_ros.compiled import compiled\n"
    (package / "middle.py").write_text(
        source + "from elsewhere.inner import rate\n@compiled\ndef twice(x: float) -> float:\n"
        "    return 2.0 * rate(x)\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    results, hits = [], []
    for factor in ("1.0", "1.0", "30.0"):
        (package / "inner.py").write_text(
            source + f"@compiled\ndef rate(x: float) -> float:\n    return {factor} * x\n", encoding="utf-8"
        )
        for name in ("elsewhere", "elsewhere.middle", "elsewhere.inner"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        twice: Any = importlib.import_module("elsewhere.middle").twice
        results.append(twice(1.0))
        hits.append(sum(twice.dispatcher.stats.cache_hits.values()))
    assert (results, hits) == ([2.0, 2.0, 60.0], [0, 1, 0])


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: content[:0],
    "truncated": lambda content: content[: len(content) // 2],
    "one byte changed": lambda content: content[:-200] + bytes([content[-200] ^ 1]) + content[-199:],
    "zeros": lambda content: bytes(len(content)),
    "another file": lambda content: content.hex().encode(),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damaged_code_is_compiled_again_with_one_line(
    folder: Path, caplog: pytest.LogCaptureFixture, kind: str
) -> None:
    run()
    (file,) = files(folder)
    good = file.read_bytes()
    file.write_bytes(DAMAGE[kind](good))
    assert run() == 0
    assert [record.getMessage().count("\n") for record in caplog.records] == [0]
    assert "a damaged file: it is compiled again" in caplog.text
    assert run() == 1  # it was put right
    assert len(caplog.records) == 1


def test_code_that_is_no_code_is_compiled_again(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    run()
    (file,) = files(folder)
    content = pickle.dumps(("nonsense",))
    file.write_bytes(hashlib.sha256(content).digest() + content)
    assert run() == 0
    assert "expected compiled code" in caplog.text


def test_a_folder_that_cannot_be_made_costs_a_line(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder.write_text("a file in the folder's place")
    assert [run(), run()] == [0, 0]
    assert len(caplog.records) == 1
    assert "it is compiled " in caplog.text


def test_a_full_disk_costs_a_line_and_leaves_nothing(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        assert run() == 0
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    assert [path for path in folder.rglob("*") if path.is_file()] == []
    assert "cannot be kept (OSError: [Errno 27] File too large" in caplog.text


def test_code_of_another_cpu_or_with_other_options_is_left_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import llvmlite.binding

    run()
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_name", lambda: "pentium")
    compile_cache._key.cache_clear()
    assert run() == 0
    monkeypatch.setenv("NUMBA_BOUNDSCHECK", "1")
    compile_cache._key.cache_clear()
    assert run() == 0
    assert len({file.parent for file in files(folder)}) == 3


def test_without_a_home_the_folder_beside_the_sources_is_the_only_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("HOME")

    def nobody(user: int) -> None:
        raise KeyError(user)

    monkeypatch.setattr("pwd.getpwuid", nobody)
    (only,) = compile_cache._folders()
    assert only.parent == Path(compile_cache.__file__).parent / "__pycache__"
    monkeypatch.setenv("HOME", os.sep + "home")
    assert len(list(compile_cache._folders())) == 2
