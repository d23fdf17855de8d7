"""What each verb of `waam scan` does: read, compute, write."""
