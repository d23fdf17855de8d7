"""Programs for machines: G-code, compact G-code, Fanuc, plan files, axis correction."""
