"""Execution of chains with checks of base, area and inputs; without ROS, time is passed in."""
