"""What is asked for, and the key of every file on the way to it."""
