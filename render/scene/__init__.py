"""Plain descriptions of a picture: geometry, camera, lights, stage, materials, quality; no renderer"""
