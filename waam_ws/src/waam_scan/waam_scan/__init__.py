"""Profiles and poses become height maps with an uncertainty per cell; calibration, registration and recordings."""
