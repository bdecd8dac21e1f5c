"""Teleo-operators, their conditions, chains and the chain executor."""
