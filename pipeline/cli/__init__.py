"""The command line: parsing, progress and messages only."""
