"""Discrete minimal surfaces: the baseline, and the start of the exact solver."""
