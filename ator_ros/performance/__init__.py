"""Performance models of actions: features, model trees, their rules and their files (paper, section 3)."""
