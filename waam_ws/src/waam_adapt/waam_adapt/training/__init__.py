"""Training of the correction network (needs torch)."""
