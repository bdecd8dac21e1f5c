"""The paper's action set: a Bezier curve to the goal, recomputed at every tick (paper, section 3)."""
