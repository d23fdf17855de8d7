"""Where the scanner sits on the torch: artefact, least squares, the stored result."""
