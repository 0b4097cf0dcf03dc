"""Mitsuba: its engine, and scenes built from plain descriptions."""
