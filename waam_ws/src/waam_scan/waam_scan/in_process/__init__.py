"""Profiles that are measured beside the burning arc."""
