"""Points to heights: streaming fusion, cell estimator, quality and plausibility of a map."""
