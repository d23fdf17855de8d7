"""Training of the correction network on layers of the laboratory; torch is needed here and nowhere else."""
