"""Simulated robots, objects and sensors."""
