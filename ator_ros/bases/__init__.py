"""What depends on how a robot moves: its description, routes for its size, the differential base."""
