"""A port for a page of a test."""

import socket


def free_port() -> int:
    """Return a port that nobody uses at present."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
