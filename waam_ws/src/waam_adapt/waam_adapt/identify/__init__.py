"""What the layers teach about the process."""
