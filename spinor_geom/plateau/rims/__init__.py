"""Minimal surfaces between several loops, on disks with round holes."""
