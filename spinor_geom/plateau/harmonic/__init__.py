"""Minimal disks by Douglas's method on smooth plane domains."""
