"""Subgoal refinement: free variables, search, prediction of a chain, gate."""

from ator_ros.printable import ReadableError


class RefinementError(ReadableError, ValueError):
    """A request cannot be refined; the message has the expected and the actual value."""
