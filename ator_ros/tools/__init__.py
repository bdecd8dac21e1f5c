"""Command lines: collect, train, evaluate, demo, bench."""
