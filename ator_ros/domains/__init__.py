"""Domains: each is a folder of TOPs, actions, situations and chains; the core names none of them."""
