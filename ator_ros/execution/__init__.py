"""Execution of chains, and the checks of base, area and inputs meanwhile. No ROS, no clock."""
