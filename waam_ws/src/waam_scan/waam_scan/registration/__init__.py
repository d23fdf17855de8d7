"""Clouds of a part brought together: placement, drift, odometry, comparison."""
