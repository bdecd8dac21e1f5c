"""Foreign texts and numbers in the Markdown of a view."""

from __future__ import annotations

import re

from ator_ros.printable import printable

_MEANS_SOMETHING = re.compile(r"([\\`*_{}\[\]<>#|~$!])")
_MOST_SECONDS = 1e6
_LONGEST = 300


def plain(text: str, most: int = _LONGEST) -> str:
    """Return a text so that Markdown, in which browsers take braces for a program, shows it as it is."""
    return _MEANS_SOMETHING.sub(r"\\\1", printable(text, most))


def seconds(value: float) -> str:
    """Return a number of seconds for a table; `-` for one that is not known, or no time."""
    return f"{value:.2f}" if abs(value) < _MOST_SECONDS else "-"
