"""Plain descriptions: geometry, camera, lights, stage, materials, quality."""
