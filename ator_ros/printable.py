"""External text, shortened and without control characters, for logs, responses and terminals."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from typing import ClassVar

_LISTED = 120  # characters of each text of a list: whole sentences, such as reasons
_LONGEST = 300  # characters of a message: three sentences, which fit on a page and in a terminal
_TAIL = 100  # characters kept of the end of a long message, where it says what to do
_PART = "; "
_MORE = re.compile(r"; and (\d{1,9}) more$")  # at the end of a list that was cut before


def printable(text: object, most: int = 60) -> str:
    """Return at most `most` characters of a text, escaped as in Python if they are not printable.

    A shortened text ends with the full length. Every text from outside passes through here, or
    through `quoted` or `listed`, on its way into a log, an answer or a page: names of frames,
    nodes, topics, objects, TOPs, files and keys, and reasons of other programs.
    """
    whole = text if isinstance(text, str) else _written(text, str)
    shown = "".join(
        character if character.isprintable() else repr(character)[1:-1]
        for character in whole[:most]
    )
    if len(whole) > most or len(shown) > most:
        return f"{shown[:most]}… ({len(whole)} characters)"
    return shown


def listed(
    texts: Iterable[object],
    most: int = 5,
    *,
    separator: str = ", ",
) -> str:
    """Return at most `most` texts, each `printable`, and the number of the others.

    Such as `a, b, … and 12 more`.
    """
    every = list(texts)
    shown = [printable(text, _LISTED) for text in every[:most]]
    if len(every) > most:
        shown.append(f"… and {len(every) - most} more")
    return separator.join(shown)


def one_line(text: object, most: int = _LONGEST) -> str:
    """Return a message as one printable line of at most `most` characters.

    Of a long one whose parts are separated by semicolons, the first parts and the number of the
    others are kept; of any other, its beginning and its end.
    """
    whole = text if isinstance(text, str) else _written(text, str)
    if len(whole) <= most and whole.isprintable():
        return whole
    spaced = " ".join(whole[: 20 * most].split())
    shown = printable(spaced, len(spaced))
    if len(whole) <= 20 * most and len(shown) <= most:
        return shown
    parts = whole.count(_PART) + 1
    if left_out := _MORE.search(whole, max(0, len(whole) - _TAIL)):
        parts += int(left_out[1]) - 1
    room = most - len(f"{_PART}and {parts} more")
    kept = shown[: room + len(_PART)].rpartition(_PART)[0]
    if kept:
        return f"{kept}{_PART}and {parts - kept.count(_PART) - 1} more"
    note = f" … ({len(whole)} characters) … "
    return f"{shown[: most - _TAIL - len(note)]}{note}{shown[-_TAIL:]}"


class ReadableError(Exception):
    """An error whose text is a message for users of at most `longest` characters: `one_line`."""

    longest: ClassVar[int] = _LONGEST

    def __init__(self, text: object = "") -> None:
        super().__init__(one_line(text, self.longest))

    def __str__(self) -> str:
        """Return the text, also where a base class would quote it."""
        return str(self.args[0])


def quoted(value: object) -> str:
    """Return a text as `printable` does, in quotes; for any other value, its repr."""
    return f"'{printable(value)}'" if isinstance(value, str) else printable(_written(value, repr))


def _written(value: object, write: Callable[[object], str]) -> str:
    """Return `write(value)`, or a description if an integer has too many digits for Python."""
    try:
        return write(value)
    except ValueError:
        return f"{type(value).__name__} of more than {sys.get_int_max_str_digits()} digits"
