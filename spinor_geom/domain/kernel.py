"""The compiled part, `cpp/kernel.cpp`, called through ctypes."""

import ctypes
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.errors import SpinorGeomError

_ADDRESS, _INTEGER, _NUMBER = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double


class _Region(ctypes.Structure):
    _fields_ = (
        ("boundary_size", _INTEGER),
        ("boundary", _ADDRESS),
        ("after", _ADDRESS),
        ("growth", _NUMBER),
        ("decay", _NUMBER),
        ("sample_count", _INTEGER),
        ("samples", _ADDRESS),
        ("log_lengths", _ADDRESS),
        ("neighbours", _INTEGER),
    )


class _Seeds(ctypes.Structure):
    _fields_ = (("count", _INTEGER), ("points", _ADDRESS), ("spacing", _ADDRESS))


class _Output(ctypes.Structure):
    _fields_ = (
        ("most_points", _INTEGER),
        ("seconds", _NUMBER),
        ("points", _ADDRESS),
        ("faces", _ADDRESS),
        ("point_count", _INTEGER),
        ("face_count", _INTEGER),
    )


class KernelRegion:
    """A plane region with wanted edge lengths, as the compiled part takes it; see `SizeField`.

    Lengths are measured from the centre of the boundary and in its radius.
    """

    def __init__(
        self,
        boundary: Complex[np.ndarray, " m"],
        after: Int[np.ndarray, " m"],
        *,
        growth: float,
        decay: float,
        samples: Complex[np.ndarray, " n"],
        lengths: Float[np.ndarray, " n"],
        neighbours: int,
    ) -> None:
        self.centre = boundary.mean()
        self.scale = float(np.abs(boundary - self.centre).max())
        self.points = (boundary - self.centre) / self.scale
        self._after = np.ascontiguousarray(after, dtype=np.int64)
        self._samples, self._logarithms = self._scaled(samples), np.log(lengths / self.scale)
        self._struct = _Region(
            len(boundary),
            self.points.ctypes.data,
            self._after.ctypes.data,
            growth,
            decay,
            len(samples),
            self._samples.ctypes.data,
            self._logarithms.ctypes.data,
            neighbours,
        )

    def _scaled(self, points: Complex[np.ndarray, " k"]) -> Complex[np.ndarray, " k"]:
        return np.ascontiguousarray((points - self.centre) / self.scale)

    def sizes(self, points: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Wanted edge lengths at points."""
        places, lengths = self._scaled(points), np.empty(len(points))
        library().sizes(ctypes.byref(self._struct), len(points), places.ctypes.data, lengths.ctypes.data)
        return lengths * self.scale

    def refined(
        self,
        faces: Int[np.ndarray, "t 3"],
        seeds: tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"]] | None,
        max_points: int,
        seconds: float,
    ) -> tuple[Complex[np.ndarray, "_"], Int[np.ndarray, "_ 3"]]:
        """The inner points and faces of a refinement of a triangulation of the boundary, whose vertices come first.

        Refinement starts from seeds, points and their spacings, or from a lattice. It stops at `max_points`, except
        for points that split long edges between boundary vertices, and after some seconds.
        """
        m = len(self.points)
        points = np.empty(2 * m + max_points, dtype=np.complex128)
        made = np.empty((len(faces) + 2 * (m + max_points), 3), dtype=np.int64)
        made[: len(faces)] = faces
        output = _Output(max_points, seconds, points.ctypes.data, made.ctypes.data, m, len(faces))
        start = _Seeds(-1)
        if seeds is not None:
            places, spacing = self._scaled(seeds[0]), np.ascontiguousarray(seeds[1] / self.scale)
            start = _Seeds(len(places), places.ctypes.data, spacing.ctypes.data)
        library().refine(ctypes.byref(self._struct), ctypes.byref(start), ctypes.byref(output))
        inner = points[m : output.point_count] * self.scale + self.centre
        return inner, made[: output.face_count].copy()


@cache
def library() -> ctypes.CDLL:
    """The compiled part of the package."""
    for suffix in EXTENSION_SUFFIXES:
        file = Path(__file__).with_name(f"_kernel{suffix}")
        if file.exists():
            found = ctypes.CDLL(str(file))
            found.sizes.argtypes = (_ADDRESS, _INTEGER, _ADDRESS, _ADDRESS)
            found.minimum_area_splits.argtypes = (_INTEGER, _ADDRESS, _NUMBER, _ADDRESS)
            for function in (found.sizes, found.refine, found.minimum_area_splits):
                function.restype = None
            return found
    raise SpinorGeomError("the compiled part of spinor_geom is missing; run `pip install .` in its source folder")
