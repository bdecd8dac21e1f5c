"""The default action set: plan a near time-optimal manoeuvre once, commit to it, track it."""
