"""Actions: control programs that return a velocity command, or none, for the state of each tick."""

DEFAULT_SET = "default"
"""The set of actions that every domain has."""
TIME_LIMIT = 30.0
"""Default time in s that an action or a step of a chain may take."""
