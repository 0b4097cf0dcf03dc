"""One frame rendered: sample batches, motion samples, AOVs, checkpoints."""
