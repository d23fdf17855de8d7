"""Programs of others: G-code to motions, motions to layers and beads, these to a plan."""
