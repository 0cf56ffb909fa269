"""A cable at the free edge of a film that is not plane: its curvature is constant."""

from __future__ import annotations
