"""The robot bridge: the job's segments on a six-axis arm with a positioner."""
