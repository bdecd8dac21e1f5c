"""Subgoal refinement: free variables, search, prediction of a chain, gate."""


class RefinementError(ValueError):
    """A request that cannot be refined; the message says what was expected and what was given."""
