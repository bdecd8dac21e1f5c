"""Execution: one state machine that runs a chain, and what watches over it. Without ROS, without a clock."""
