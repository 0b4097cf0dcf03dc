"""Relighting: finished frames with their light groups mixed anew, without rendering."""
