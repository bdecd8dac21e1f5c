"""Evaluation: trials, policies, the oracle, and what their runs show."""
