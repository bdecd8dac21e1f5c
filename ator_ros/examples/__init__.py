"""Programs of somebody else, as far as ator_ros is concerned: they import nothing of it."""
