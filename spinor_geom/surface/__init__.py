"""Minimal surfaces from two holomorphic functions."""
