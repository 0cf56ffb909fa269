"""Minimal disks by Douglas's method on the unit disk and smooth plane domains."""
