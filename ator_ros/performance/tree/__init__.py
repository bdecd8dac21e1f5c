"""The model tree: a regression tree with linear models at its leaves (paper, section 3)."""
