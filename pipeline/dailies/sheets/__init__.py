"""A shot on one page: its frames in rows, or its measures as figures."""
