"""The base of `render` and `pipeline`: errors, files, caches, serialisation."""
