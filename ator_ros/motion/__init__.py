"""Motion within limits: durations, turn-drive-turn paths, trajectories."""
