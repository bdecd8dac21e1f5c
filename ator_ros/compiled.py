"""Compilation of numerical functions with numba.

Division by zero gives infinity, as in numpy. Machine code is cached on disk until the function or
anything that it refers to changes: functions that it calls, types of its arguments, constants.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import os
import sys
from collections import defaultdict
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core.caching import UserProvidedCacheLocator
from numba.extending import overload, register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parent
_ANY = "*"  # all statements of a module, where a name is not enough
_NAMELESS = ""  # the statements of a module that define no name


def code_digest(module: str, name: str) -> str:
    """Return a digest of the code that a function consists of.

    Parameters
    ----------
    module, name
        An imported module, and the name of a function or constant in it.

    Returns
    -------
    str
        It changes with the definition of the function, and with each definition that it refers to,
        directly or not, in its own package and in this one. It does not change with docstrings,
        comments and layout, nor with other definitions of the same modules.
    """
    packages = {_PACKAGE.name, module.partition(".")[0]}
    digest = hashlib.sha256()
    pending = [(module, name)]
    seen = set()
    while pending:
        module, name = pending.pop()
        if (module, name) in seen or module.partition(".")[0] not in packages:
            continue
        seen.add((module, name))
        file = _file_of(module)
        submodule = f"{module}.{name}"
        # Looking for a submodule imports the module, which only a package needs.
        if file is not None and file.stem == "__init__" and _file_of(submodule) is not None:
            module = submodule
            name = _ANY
        definitions = _definitions(module)
        code, references = definitions.get(name, definitions[_ANY])
        digest.update(code.encode())
        pending += references
    return digest.hexdigest()


@cache
def _definitions(module: str) -> dict[str, tuple[str, list[tuple[str, str]]]]:
    """Return, of each name that a module defines, a digest and the modules and names referred to.

    Parsing all modules takes some 0.5 s, so the last result is kept beside the machine code.
    """
    file = _file_of(module)
    text = file.read_bytes() if file is not None else b""
    stamp = hashlib.sha256(text).hexdigest()
    kept = Path(numba.config.CACHE_DIR) / f"{module}.json"
    try:
        last = json.loads(kept.read_text(encoding="ascii"))
        if last["stamp"] == stamp:
            return {
                name: (code, list(map(tuple, places)))
                for name, (code, places) in last["definitions"].items()
            }
    except (OSError, ValueError):
        pass
    table = _statements(text)
    definitions = {name: _definition(module, name, table) for name in table}
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        temporary = kept.with_name(f"{kept.name}.{os.getpid()}")
        temporary.write_text(
            json.dumps({"stamp": stamp, "definitions": definitions}), encoding="ascii"
        )
        temporary.replace(kept)
    except OSError:  # the cache cannot be written
        pass
    return definitions


def _statements(text: bytes) -> dict[str, list[ast.stmt]]:
    """Return the statements of a module by the names that they define, without docstrings."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [each for each in body if not _is_text(each)]  # type: ignore[attr-defined]
    table = defaultdict(list, {_ANY: tree.body})
    for statement in tree.body:
        for name in _defined(statement):
            table[name].append(statement)
    return table


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _defined(statement: ast.stmt) -> set[str]:
    """Return the names that a statement defines."""
    if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
        return {statement.name}
    names = set()
    for node in ast.walk(statement):
        if isinstance(node, ast.alias):
            names.add(node.asname or node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names or {_NAMELESS}


def _definition(
    module: str,
    name: str,
    table: dict[str, list[ast.stmt]],
) -> tuple[str, list[tuple[str, str]]]:
    """Return the digest of the statements that define a name, and what they refer to."""
    digest = hashlib.sha256()
    references = {(module, _NAMELESS)} if _NAMELESS in table else set()
    for statement in table[name]:
        digest.update(ast.dump(statement).encode())
        for node in ast.walk(statement):
            if isinstance(node, ast.Name) and node.id in table:
                references.add((module, node.id))
            elif isinstance(node, ast.ImportFrom):
                references |= {(str(node.module), alias.name) for alias in node.names}
            elif isinstance(node, ast.Import):
                references |= {(alias.name, _ANY) for alias in node.names}
    return digest.hexdigest(), sorted(references)


@cache
def _file_of(module: str) -> Path | None:
    """Return the source of a module, None if there is no such module."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):  # ValueError: a script
        file = getattr(sys.modules.get(module), "__file__", None)
    else:
        file = spec.origin if spec is not None else None
    return Path(file) if file is not None else None


class CodeLocator(UserProvidedCacheLocator):  # type: ignore[misc] # numba has no type hints
    """Keeps machine code as long as the `code_digest` of a function stays the same.

    numba itself compiles a function again if anything in its own file changes, docstrings
    included, but not if a function changes that it calls.
    """

    def __init__(self, py_func: Any, py_file: str) -> None:
        # The installed package links to the sources: both share their machine code.
        super().__init__(py_func, str(Path(py_file).resolve()))
        module = py_func.__module__
        name = py_func.__qualname__.partition(".")[0]
        self._digest = code_digest(module, name)
        prefix = f"{Path(py_file).stem}."
        for file in Path(self.get_cache_path()).glob(f"{prefix}*.nb?"):
            cached = file.name.removeprefix(prefix).partition(".")[0].partition("-")[0]
            is_former = cached == name and self._digest not in file.name
            if is_former or cached not in _definitions(module):
                file.unlink(missing_ok=True)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> CodeLocator | None:
        """Return the locator of a function; None leaves those of other packages to numba."""
        file = Path(py_file)
        if not file.is_file() or _PACKAGE.name not in file.read_text(encoding="utf-8"):
            return None
        locator: CodeLocator | None = super().from_function(py_func, py_file)
        return locator

    def get_source_stamp(self) -> str:
        """Return what invalidates machine code when it changes."""
        return self._digest

    def get_disambiguator(self) -> str:
        """Return the part of the file names that separates machine code of two definitions."""
        return self._digest


def _cache_folder() -> Path:
    """Return the folder of machine code; variables such as NUMBA_BOUNDSCHECK change the code."""
    options = sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))
    kind = hashlib.sha256(repr(options).encode()).hexdigest()[:8]
    return _PACKAGE / "__pycache__" / f"numba-{kind}"


if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = str(_cache_folder())
if not numba.config.CACHE_LOCATOR_CLASSES:
    others = "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator"
    numba.config.CACHE_LOCATOR_CLASSES = f"{CodeLocator.__module__}.{CodeLocator.__name__},{others}"


def is_cached() -> bool:
    """Return whether a process has already compiled functions of this package."""
    return any(Path(numba.config.CACHE_DIR).rglob("*.nbi"))


def compiled(function: Function, **options: bool) -> Function:
    """Return `function` compiled at its first call."""
    try:
        result: Function = numba.njit(error_model="numpy", cache=True, **options)(function)
    except RuntimeError:  # the cache cannot be written
        result = numba.njit(error_model="numpy", **options)(function)
    return result


def inlined(function: Function) -> Function:
    """Return `function` compiled into its callers.

    Passing many arguments would take longer than the call.
    """
    return compiled(function, forceinline=True)


def elementwise(function: Function) -> Function:
    """Return `function` compiled for compiled callers only.

    Python calls it with arrays of any shape.

    Compiling each combination of shapes would take seconds, and numpy is as fast with arrays. The
    results are bitwise equal.
    """
    result: Function = register_jitable(error_model="numpy")(function)
    return result


def least(one: Any, other: Any) -> Any:
    """Return the lesser of two numbers; of arrays, elementwise."""
    return np.minimum(one, other)


def greatest(one: Any, other: Any) -> Any:
    """Return the greater of two numbers; of arrays, elementwise."""
    return np.maximum(one, other)


def where(
    which: Any,
    one: Any,
    other: Any,
) -> Any:
    """Return `one` where `which` holds, else `other`."""
    return np.where(which, one, other)[()]  # a number if all are numbers


# Unlike numpy's functions, these forms allow compiled loops to be vectorized.
overload(least)(lambda one, other: lambda one, other: min(one, other))  # noqa: ARG005
overload(greatest)(lambda one, other: lambda one, other: max(one, other))  # noqa: ARG005
overload(where)(
    lambda which, one, other: lambda which, one, other: one if which else other  # noqa: ARG005
)
