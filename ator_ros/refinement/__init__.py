"""Subgoal refinement: free variables, search, gate."""
