"""Where layers lie and what a plane cuts."""
