"""Optimized execution of action chains with learned performance models (Stulp and Beetz, IJCAI 2005)."""

__version__ = "0.2.0"
