"""Logs of others: text with columns, a mapping that says what they are, and messages of this software from both."""
