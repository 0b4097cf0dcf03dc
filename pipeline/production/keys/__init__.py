"""Keys: digests of all that a file is made from."""
