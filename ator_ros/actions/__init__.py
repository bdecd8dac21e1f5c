"""Actions: control programs. Each tick takes the estimated state and returns a velocity command, or none."""

DEFAULT_SET = "default"
"""The set of actions that every domain has."""
TIME_LIMIT = 30.0
"""Default time in s that an action or a step of a chain may take."""
