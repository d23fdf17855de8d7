"""The verbs of `waam jobs`, by what they do."""
