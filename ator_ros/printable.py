"""External text, shortened and without control characters, for logs, responses and terminals."""

from __future__ import annotations


def printable(text: object, most: int = 60) -> str:
    """Return at most `most` characters of a text; those that are not printable are escaped as in Python.

    A shortened text ends with the full length.
    """
    whole = text if isinstance(text, str) else str(text)
    shown = "".join(
        character if character.isprintable() else repr(character)[1:-1]
        for character in whole[:most]
    )
    if len(whole) > most or len(shown) > most:
        return f"{shown[:most]}… ({len(whole)} characters)"
    return shown


def quoted(value: object) -> str:
    """Return a text as `printable` does, in quotes; for any other value, its repr."""
    return f"'{printable(value)}'" if isinstance(value, str) else printable(repr(value))
