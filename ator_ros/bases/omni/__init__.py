"""The omnidirectional base: limits, fastest motions and their times, response to commands."""
