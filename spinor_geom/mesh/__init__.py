"""Triangle meshes, their boundary loops, and the smooth curves through them, by numpy, scipy and libigl only."""
