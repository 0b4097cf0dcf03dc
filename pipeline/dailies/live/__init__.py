"""A page on this machine that follows a shot while it is simulated, and again after each edit."""
