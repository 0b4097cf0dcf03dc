"""What runs take, before and after."""
