"""Command lines, one file each: a typed function and its parser."""
