"""The rest of a layer, corrected by what was seen while its first beads were laid."""
