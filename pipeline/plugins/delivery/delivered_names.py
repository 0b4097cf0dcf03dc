"""The ends of names of deliverables, and the timecode of films, which timelines name too."""

FILM_START = 3600  # the timecode of a film's first frame, in seconds: 01:00:00:00 leaves room for leaders

NAME_ENDS = {"spherical": "_360", "vr180": "_180_LR"}
"""Ends of the names of deliverables by projection: many players of headsets go by names."""
