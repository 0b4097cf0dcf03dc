"""The input-addressed store: where files lie, and how they are written and read."""
