"""Minimal surfaces with cables at their edges."""
