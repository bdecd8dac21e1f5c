"""Division of a round among several robots."""
