"""The job: one part from the first scan to the report."""
