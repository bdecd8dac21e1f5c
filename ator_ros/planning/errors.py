"""Why there is no plan."""

from __future__ import annotations


class PlanningError(ValueError):
    """A goal without a plan, or that cannot be used; the message says which condition no TOP achieves."""
