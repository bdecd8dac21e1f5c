"""Text from outside, made fit for a log, an answer or a terminal: short, and without control characters."""

from __future__ import annotations

LONGEST = 60
"""Characters of a foreign text that are shown, so that a sentence about it keeps below 200."""
_LONGEST_WHOLE = 200
"""Characters up to which `short` shows a value whole."""


def printable(text: object, most: int = LONGEST) -> str:
    """Return at most `most` characters of a text, with what no terminal should be sent escaped as in Python.

    That is all that has no picture of its own: control characters, escape sequences, marks that change the
    direction of writing, halves of surrogate pairs. Where something is cut off, the whole length is named.
    """
    whole = text if isinstance(text, str) else str(text)
    shown = "".join(
        character if character.isprintable() else repr(character)[1:-1] for character in whole[:most]
    )
    if len(whole) > most or len(shown) > most:
        return f"{shown[:most]}… ({len(whole)} characters)"
    return shown


def quoted(value: object, most: int = LONGEST) -> str:
    """Return a foreign text as `printable` does, in quotes; anything else as Python writes it."""
    return f"'{printable(value, most)}'" if isinstance(value, str) else printable(repr(value), most)


def short(value: object) -> str:
    """Return `value` as Python writes it; of a long one, its beginning and its end."""
    return short_path(repr(value))


def short_path(path: str) -> str:
    """Return a path into a file; of a long one, its beginning and its end."""
    return path if len(path) <= _LONGEST_WHOLE else f"{path[:80]} … {path[-80:]}"
