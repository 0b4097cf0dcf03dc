"""From arrays to pictures and films. Knows no shot and no flow, and never imports `pipeline`."""
