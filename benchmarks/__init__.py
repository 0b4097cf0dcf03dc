"""How fast and how good resampler, flows and pictures are, against the machine and against their peers."""
