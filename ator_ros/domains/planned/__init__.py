"""Actions that plan a manoeuvre once, commit to it, and track it: what domains share."""
