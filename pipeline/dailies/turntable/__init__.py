"""Turntables: an object turned before the camera, then the lights around it, in one look or several."""
