"""Versions and wedges by the real command and the real workflow, from the shot file to the comparison."""

from __future__ import annotations
