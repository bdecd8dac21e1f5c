"""Evaluation: trials, policies, the oracle, and statistics of their runs."""
