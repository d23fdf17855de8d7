"""The simulated cell fitted to records of one's own: `waam lab fit`."""
