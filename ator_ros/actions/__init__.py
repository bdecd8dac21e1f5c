"""Actions: control programs. Each tick takes the estimated state and returns a velocity command, or none."""
