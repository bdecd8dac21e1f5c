"""Run something until Ctrl-C, SIGTERM or the end of the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable

from ator_ros.tools.guard import ending_signals, handled, report, write_plainly


class _Stopped(Exception):  # noqa: N818 (no error)
    """The user has ended it."""


def until_stopped(
    program: str, serve: Callable[[Callable[[], None]], None], expected: tuple[type[Exception], ...]
) -> int:
    """Run until Ctrl-C, SIGTERM or the end of the terminal, its usual end; return the exit code.

    Parameters
    ----------
    program : str
        Its name, for messages.
    serve : callable
        What runs. It gets a function that it calls again and again, and which ends it by an exception.
    expected : tuple of type
        Errors that are reported in one line.
    """
    write_plainly()
    stopped: list[int] = []

    def going_on() -> None:
        if stopped:
            raise _Stopped

    try:
        with handled(dict.fromkeys(ending_signals(), lambda number, _: stopped.append(number))):
            serve(going_on)
    except ImportError as error:
        print(f"{program}: {error}: docs/install.md says how to install it", file=sys.stderr)
        return 1
    except _Stopped:
        return 0
    except expected as error:
        report(program, error)
        return 1
    return 0
