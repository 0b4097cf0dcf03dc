"""A local page that shows a shot while it is simulated, and again after each edit."""
