"""The error of refinement."""


class RefinementError(ValueError):
    """A request that cannot be refined; the message says what was expected and what came."""
