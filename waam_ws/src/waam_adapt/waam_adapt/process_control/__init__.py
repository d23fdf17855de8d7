"""A chosen value of the process held by the feed override (source 004)."""
