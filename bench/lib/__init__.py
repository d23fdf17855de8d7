"""What the benchmarks share: plants, graphs, parts, checks, and how a figure is printed."""
