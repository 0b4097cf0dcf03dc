"""Shot files as text: source positions, inheritance, overrides, messages."""
