"""From rendered samples to pictures: denoising, colour, files."""
