"""Continuation of minimal surfaces across straight sides and sides in planes of symmetry."""
