"""What a job keeps on disk."""
