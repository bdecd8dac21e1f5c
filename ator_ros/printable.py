"""Text from outside, shortened and without control characters, for logs, answers and terminals."""

from __future__ import annotations

LONGEST = 60
"""Default number of characters that are shown."""
_LONGEST_WHOLE = 200
"""Characters up to which `short` shows a value whole."""


def printable(text: object, most: int = LONGEST) -> str:
    """Return at most `most` characters of a text, with those that are not printable escaped as in Python.

    Among these are control characters, escape sequences, changes of the writing direction, and halves of
    surrogate pairs. A text that is cut off ends with its whole length.
    """
    whole = text if isinstance(text, str) else str(text)
    shown = "".join(
        character if character.isprintable() else repr(character)[1:-1] for character in whole[:most]
    )
    if len(whole) > most or len(shown) > most:
        return f"{shown[:most]}… ({len(whole)} characters)"
    return shown


def quoted(value: object, most: int = LONGEST) -> str:
    """Return a text as `printable` does, in quotes; for any other value, its repr."""
    return f"'{printable(value, most)}'" if isinstance(value, str) else printable(repr(value), most)


def short(value: object) -> str:
    """Return the repr of `value`; if it is long, its beginning and end."""
    return short_path(repr(value))


def short_path(path: str) -> str:
    """Return a text such as a path into a file; if it is long, its beginning and end."""
    return path if len(path) <= _LONGEST_WHOLE else f"{path[:80]} … {path[-80:]}"
