"""The parts of `bench`, and requests that load a node."""
