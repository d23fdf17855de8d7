"""A plan as a picture, a table and a page."""
