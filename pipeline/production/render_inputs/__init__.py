"""What pictures are rendered from, besides the mesh: shading normals, cameras, motion."""
