"""Who of several robots does what."""
