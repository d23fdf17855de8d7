"""How a layer is covered with beads: strategies, order of lines, stations along the path."""
