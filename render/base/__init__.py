"""What all of `render` and `pipeline` build on: errors, files, caches, serialisation."""
