"""Checks of raw shot data beyond the form of single values."""
