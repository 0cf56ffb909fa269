"""Minimal disks and annuli as Cauchy networks, by Gauss-Newton."""
