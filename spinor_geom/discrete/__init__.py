"""Discrete minimal surfaces: the baseline, and the initial surface of the exact solver."""
