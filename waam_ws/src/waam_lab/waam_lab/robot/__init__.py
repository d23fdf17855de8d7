"""The laboratory on a robot: its cell, a plan run without metal, and what the robot will make of a plan."""
