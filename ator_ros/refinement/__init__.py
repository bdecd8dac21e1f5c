"""Subgoal refinement: free variables, search, prediction of a chain, gate."""


class RefinementError(ValueError):
    """A request cannot be refined; the message has the expected and the actual value."""
