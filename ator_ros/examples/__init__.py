"""The action servers of the domains tour and pursuit; they stand for your own: nothing else is imported."""
