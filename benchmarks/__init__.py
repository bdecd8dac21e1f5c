"""Comparisons with other tools; run from a checkout, not installed."""
