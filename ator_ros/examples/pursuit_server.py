"""An action server that drives a differential base to a pose as Nav2 does, without Nav2.

It differs from `drive_to_server` in the name of its action, `pursue`, and in its control law.
"""

from __future__ import annotations

from functools import partial

from ator_ros.examples.drive_to_server import DriveToServer, serve
from ator_ros.examples.pursuit import Pursuit


def main(args: list[str] | None = None) -> None:
    """Run the server until Ctrl-C or SIGTERM."""
    serve(partial(DriveToServer, "pursuit_server", "pursue", Pursuit), args)


if __name__ == "__main__":
    main()
