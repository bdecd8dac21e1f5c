"""Command lines. What they do is in `work`, which is imported once a line is understood."""
