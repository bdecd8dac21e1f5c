"""The longest ticks of a domain's actions while they plan."""

from __future__ import annotations

from ator_ros.domains.domain import find_domain
from ator_ros.domains.measurements import Ticks
from ator_ros.evaluation.toolset import ToolsetSource


def measure(source: ToolsetSource) -> Ticks:
    """Return what the domain measures of its actions' ticks.

    Raises
    ------
    RuntimeError
        It measures none.
    """
    domain = find_domain(source.domain)
    if domain.measurements.longest_ticks is None:
        raise RuntimeError(f"expected a domain with measurements.longest_ticks, got {domain.name}")
    return domain.measurements.longest_ticks(source.described())
