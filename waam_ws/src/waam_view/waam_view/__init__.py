"""What people see of a job: the live dashboard (rerun) and the report."""
