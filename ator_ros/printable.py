"""External text, shortened and without control characters, for logs, responses and terminals."""

from __future__ import annotations

from collections.abc import Iterable

_LISTED = 120  # characters of each text of a list: whole sentences, such as reasons


def printable(text: object, most: int = 60) -> str:
    """Return at most `most` characters of a text; those that are not printable are escaped as in Python.

    A shortened text ends with the full length. Every text from outside passes through here, or
    through `quoted` or `listed`, on its way into a log, an answer or a page: names of frames, nodes,
    topics, objects, TOPs, files and keys, and reasons of other programs.
    """
    whole = text if isinstance(text, str) else str(text)
    shown = "".join(
        character if character.isprintable() else repr(character)[1:-1]
        for character in whole[:most]
    )
    if len(whole) > most or len(shown) > most:
        return f"{shown[:most]}… ({len(whole)} characters)"
    return shown


def listed(texts: Iterable[object], most: int = 5, *, separator: str = ", ") -> str:
    """Return at most `most` texts, each `printable`, and the number of the others: `a, b, … and 12 more`."""
    every = list(texts)
    shown = [printable(text, _LISTED) for text in every[:most]]
    if len(every) > most:
        shown.append(f"… and {len(every) - most} more")
    return separator.join(shown)


def quoted(value: object) -> str:
    """Return a text as `printable` does, in quotes; for any other value, its repr."""
    return f"'{printable(value)}'" if isinstance(value, str) else printable(repr(value))
