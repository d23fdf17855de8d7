"""Calibration of the machine: what is measured, what follows from it, and whether the evidence is good enough."""
