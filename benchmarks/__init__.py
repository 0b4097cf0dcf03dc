"""How fast and how good the resampler is, against the machine's memory and against its peers."""
