"""Setpoints of segments: speed, wire feed, voltage, and the lead of the wire."""
