"""Optimized execution of action chains with learned performance models.

The method is that of Stulp and Beetz, IJCAI 2005.
"""

__version__ = "0.2.0"
