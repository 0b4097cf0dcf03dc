"""Look after a root: why a frame is stale, verify, clean, report on runs."""
