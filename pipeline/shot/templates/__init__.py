"""Templates of new shot files."""
