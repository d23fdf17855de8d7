"""Archive of all jobs: one file tree of Parquet that answers questions over thousands of them."""
