"""What is there and what is not, why, and whether it is as it should be."""
