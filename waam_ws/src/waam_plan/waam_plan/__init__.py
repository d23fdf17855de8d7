"""Part -> layers -> segments -> program. Pure Python, metres, work frame."""
