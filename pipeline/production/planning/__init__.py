"""From requests to plans: which files are missing, in what jobs they are made, what that takes."""
