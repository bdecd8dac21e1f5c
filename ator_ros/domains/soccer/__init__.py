"""Robot soccer, the first domain and the default: go to the ball, dribble it, shoot."""
