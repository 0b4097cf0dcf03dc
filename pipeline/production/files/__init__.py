"""The store, and how its files are written, read and looked at."""
