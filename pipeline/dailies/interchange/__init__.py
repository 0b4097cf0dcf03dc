"""Interchange: sculptures as files of other programs, USD stages and mesh files."""
