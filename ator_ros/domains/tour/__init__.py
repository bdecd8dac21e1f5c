"""A tour of stations, driven by an action server that knows nothing of ator_ros."""
