"""Read and write mesh files: OBJ, PLY, OFF, STL, GLB, NPZ, XYZ."""
