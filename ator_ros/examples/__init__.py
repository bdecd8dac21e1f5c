"""The action servers of the domains tour and pursuit, as examples of external servers."""
