"""Learning while the robot plays: sets of models from records, and when to switch to one."""
