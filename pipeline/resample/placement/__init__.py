"""Placements: on the chord, on curved patches, on the exact surface."""
