"""Named encodes of shots and films, with slates and burn-ins, and the edit as a timeline."""
