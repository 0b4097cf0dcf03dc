"""From mesh frames to what pictures are made from: shading, cameras, movement."""
