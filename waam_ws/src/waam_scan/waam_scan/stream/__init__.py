"""From the scanner to posed profiles: batches, poses, one scan from begin to finish."""
