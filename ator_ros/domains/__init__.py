"""Domains: each is a folder of TOPs, actions, situations and chains; the core names none of them."""

DEFAULT = "soccer"
"""The domain that is used where no other is named."""
