"""Files as typed classes: cattrs structures what a parser read, strictly, and says where it does not fit.

A schema is a dataclass. Its annotations say what each field must be: numbers are finite, nothing is converted
silently (no "3" for 3, no true for 1), a union is the first of its types that fits, and `Within`, `OneOf`,
`Name` and `AtMost` narrow further. Fields without a default are required. A schema's own ``__post_init__``
raises ValueError for what fields can't say alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sized
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from cattrs import ClassValidationError, IterableValidationError
from cattrs.errors import ForbiddenExtraKeysError

from ator_ros.printable import short, short_path
from ator_ros.schema_hooks import CLOSED, OPEN, names_of_fields

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")


class SchemaError(ValueError):
    """Data that does not fit its schema; the message is one line: field, what was expected, what came."""


@dataclass(frozen=True)
class Within:
    """In `Annotated`: a number lies from `least` to `most`."""

    least: float = -math.inf
    most: float = math.inf

    def check(self, value: float) -> str | None:
        """Return what was expected, if `value` lies outside."""
        if self.least <= value <= self.most:
            return None
        if math.isinf(self.most):
            return f"a finite number of at least {self.least:g}"
        return f"a number from {self.least:g} to {self.most:g}"


@dataclass(frozen=True)
class OneOf:
    """In `Annotated`: a text is one of `names`."""

    names: tuple[str, ...]

    def check(self, value: str) -> str | None:
        """Return what was expected, if `value` is none of the names."""
        return None if value in self.names else f"one of {', '.join(self.names)}"


@dataclass(frozen=True)
class Name:
    """In `Annotated`: a text is a name of letters, digits and _, not beginning with a digit."""

    def check(self, value: str) -> str | None:
        """Return what was expected, if `value` is no name."""
        return None if value.isascii() and value.isidentifier() else "a name of letters, digits and _"


@dataclass(frozen=True)
class AtMost:
    """In `Annotated`: a list or a table has at most `most` entries."""

    most: int

    def check(self, value: Sized) -> str | None:
        """Return what was expected, if `value` has more."""
        return None if len(value) <= self.most else f"at most {self.most} entries"


def structured(data: object, schema: type[T], where: str = "", *, closed: bool = False) -> T:
    """Return `data` as an instance of `schema`.

    Parameters
    ----------
    data : object
        What a parser read.
    schema : type
        A dataclass, or a type built of them.
    where : str
        Path of `data` in its file, for messages.
    closed : bool
        Whether fields that the schema lacks are refused; otherwise they are left out.

    Raises
    ------
    SchemaError
        It does not fit; the message names the first field that does not.
    """
    try:
        return (CLOSED if closed else OPEN).structure(data, schema)
    except Exception as error:  # cattrs raises groups, schemas raise ValueError
        path, text = next(_problems(error, where))
        raise SchemaError(f"{short_path(path)}: {text}" if path else text) from error


def unstructured(data: DataclassInstance) -> dict[str, Any]:
    """Return the fields of a dataclass as a file holds them; `structured` reads them back.

    A field that is None, and by default so, is left out.
    """
    plain: dict[str, Any] = OPEN.unstructure(data)
    return plain


def require(holds: bool, name: str, expected: str, value: object) -> None:
    """Raise ValueError about the field `name` unless something holds; for a schema's ``__post_init__``."""
    if not holds:
        raise ValueError(f"{name}: expected {expected}; got {short(value)}")


def _problems(error: BaseException, path: str) -> Iterator[tuple[str, str]]:
    """Find the single errors in what cattrs raised, each with its path in the file."""
    if isinstance(error, ClassValidationError):
        named, others = error.group_exceptions()
        for inner, note in named:
            if not isinstance(inner, KeyError):
                yield from _problems(inner, f"{path}.{note.name}" if path else note.name)
        for inner in others:
            if not isinstance(inner, ForbiddenExtraKeysError):
                yield from _problems(inner, path)
        missing = [note.name for inner, note in named if isinstance(inner, KeyError)]
        unknown = [str(n) for e in others if isinstance(e, ForbiddenExtraKeysError) for n in e.extra_fields]
        if missing or unknown:
            found = [f"missing {', '.join(sorted(missing))}"] if missing else []
            found += [f"unknown {', '.join(sorted(unknown))}"] if unknown else []
            yield path, f"expected the fields {names_of_fields(error.cl)}; {short_path(' and '.join(found))}"
    elif isinstance(error, IterableValidationError):
        for inner, item in error.group_exceptions()[0]:
            place = f"[{item.index}]" if isinstance(item.index, int) else f".{item.index}"
            yield from _problems(inner, path + place)
    else:
        yield path, str(error)
