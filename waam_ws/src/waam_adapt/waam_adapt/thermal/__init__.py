"""Interpass temperature: may the next layer start, and when."""
