"""Example programs from outside: they import nothing of ator_ros."""
