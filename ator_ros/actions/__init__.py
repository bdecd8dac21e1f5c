"""Actions: control programs, one tick in, one velocity command out."""
