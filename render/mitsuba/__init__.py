"""Descriptions become Mitsuba scenes; choosing and starting its engine."""
