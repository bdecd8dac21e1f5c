"""Experience: episodes of actions, from the simulator, records and recordings."""
