"""Teleo-operators (TOPs), their conditions, their library, and chains of them."""
