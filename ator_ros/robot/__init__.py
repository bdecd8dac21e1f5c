"""The robot: its description, and how a base follows commands."""
