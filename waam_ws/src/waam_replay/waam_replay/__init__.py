"""Computes a recorded job again: offline through the pure cores, or on the graph in lock-step."""
