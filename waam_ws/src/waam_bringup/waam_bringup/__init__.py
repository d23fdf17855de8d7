"""Starts the graph and operates it: the supervisor, the demo and the command `waam`."""
