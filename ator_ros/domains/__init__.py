"""Domains: each has TOPs, actions, situations and chains; the core names none of them."""

DEFAULT = "soccer"
"""The domain of a robot that can hold the objects of soccer, where no other is named."""
DRIVE = "drive"
"""The domain of any other robot, where no other is named."""
