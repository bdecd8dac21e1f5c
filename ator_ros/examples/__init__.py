"""Example programs: the paper in one file; others stand for your own and import nothing of ator_ros."""
