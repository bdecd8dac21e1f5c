"""Performance models of actions: features, model trees, rules and files (paper, section 3)."""
