"""The error of this package."""


class EvaluationError(ValueError):
    """An evaluation that cannot be run or read; the message says what was expected and what came."""
