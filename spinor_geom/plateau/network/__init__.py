"""Minimal disks and annuli as Cauchy networks, fitted by Gauss-Newton."""
