"""The quality of soccer's actions: reliability, speed against time-optimal motion, regularity."""
