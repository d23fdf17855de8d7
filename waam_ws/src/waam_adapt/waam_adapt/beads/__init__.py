"""The nominal bead model of a layer, what the beads of this job do differently, and the bounded solver."""
