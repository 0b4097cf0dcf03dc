"""Versions that are published, and shots with other values in them."""
