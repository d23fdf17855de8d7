"""From the scanned surface to the correction of the next layer."""
