"""The job as it runs: preparation, layers, scans, resume, verdict."""
