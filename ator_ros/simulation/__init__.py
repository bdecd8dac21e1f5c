"""The simulated Pioneer, the ball and the field."""
