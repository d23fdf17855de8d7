"""Computes a recorded job again through the pure cores, or plays it to a graph."""
