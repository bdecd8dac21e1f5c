"""Figures of the paper, whose domain is soccer."""
