"""Common functions for numpy arrays and torch tensors: namespaces, devices, and operations missing in the array API.

Everything is computed with numpy unless the caller asks for a torch device or for gradients. torch is imported only
then, not by this module. Differentiable functions do not write into arrays.

Source: the Python array API standard, which numpy implements; `array_api_compat` adds it to torch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Complex, Float, Inexact, Int, Shaped

if TYPE_CHECKING:
    import torch

Array: TypeAlias = Any  # a numpy array or a torch tensor

EPS = float(np.finfo(np.float64).eps)
TINY = float(np.finfo(np.float64).tiny)


_OF_NUMPY = (np.ndarray, np.generic)


def is_numpy(x: object) -> bool:
    """Whether an array is a numpy array."""
    return isinstance(x, _OF_NUMPY)


def namespace(x: Array) -> Any:
    """The array API module of an array: numpy, or array_api_compat's wrapper of torch."""
    if isinstance(x, _OF_NUMPY):  # called thousands of times in a fill
        return np
    import array_api_compat

    return array_api_compat.array_namespace(x)


@dataclass(frozen=True)
class Place:
    """The kind and device of arrays: numpy arrays, or tensors on a torch device."""

    device: torch.device | None = None  # None for numpy

    @property
    def xp(self) -> Any:
        """The array API module for arrays of this place."""
        if self.device is None:
            return np
        import array_api_compat.torch

        return array_api_compat.torch

    def put(self, values: Any) -> Array:
        """Converts an array or tensor to this place, which copies it on torch devices."""
        if self.device is None:
            return to_numpy(values)
        import torch

        if isinstance(values, torch.Tensor):
            return values.to(self.device)
        return torch.tensor(values, device=self.device)


NUMPY = Place()


def place_of(x: Array) -> Place:
    """The place of an array."""
    return NUMPY if is_numpy(x) else Place(x.device)


def to_numpy(x: Any) -> np.ndarray:
    """Converts to a numpy array without gradients. Only tensors on other devices than the CPU are copied."""
    if is_numpy(x):
        return np.asarray(x)
    if hasattr(x, "detach"):
        return np.asarray(x.detach().cpu().resolve_conj().numpy())
    return np.asarray(x)


def complex_of(real: Float[Array, "*any"], imag: Float[Array, "*any"]) -> Complex[Array, "*any"]:
    """Real + i·imag."""
    if is_numpy(real):
        whole = np.empty(real.shape, dtype=np.complex128)
        whole.real, whole.imag = real, imag
        return whole
    import torch

    return torch.complex(real, imag)


def cis(angle: Float[Array, "*any"]) -> Complex[Array, "*any"]:
    """e^{i·angle}."""
    xp = namespace(angle)
    return complex_of(xp.cos(angle), xp.sin(angle))


def as_dtype(x: Shaped[Array, "..."], dtype: Any) -> Shaped[Array, "..."]:
    """The array with another dtype of its own library."""
    return x.astype(dtype) if is_numpy(x) else x.to(dtype)


def norm(v: Inexact[Array, "*any k"]) -> Float[Array, "*any"]:
    """Euclidean lengths of the rows."""
    if is_numpy(v):  # half the time of a sum over a short axis
        return np.sqrt(np.vecdot(v, v).real)
    return namespace(v).sqrt(square(v).sum(-1))


def square(v: Inexact[Array, "*any"]) -> Float[Array, "*any"]:
    """|v|², differentiable at 0."""
    return v * v if is_real(v) else v.real * v.real + v.imag * v.imag


def is_real(v: Array) -> bool:
    """Whether an array has no imaginary parts."""
    return v.dtype.kind != "c" if is_numpy(v) else not v.is_complex()


def cross(u: Float[Array, "*any 3"], v: Float[Array, "*any 3"]) -> Float[Array, "*any 3"]:
    """Cross products. NumPy's own function takes several times as long for short arrays."""
    if not is_numpy(u):
        return namespace(u).linalg.cross(u, v)
    a, b, c, d, e, f = *(u[..., k] for k in range(3)), *(v[..., k] for k in range(3))
    product = np.empty(np.broadcast(u, v).shape)
    product[..., 0], product[..., 1], product[..., 2] = b * f - c * e, c * d - a * f, a * e - b * d
    return product


def median(values: Float[np.ndarray, "*any n"]) -> Float[np.ndarray, "*any"]:
    """Medians of rows. NumPy's own function takes three times as long for short rows."""
    count = values.shape[-1]
    low, high = (count - 1) // 2, count // 2
    ordered = np.partition(values, (low, high), axis=-1)
    return np.asarray((ordered[..., low] + ordered[..., high]) / 2)


def unit(v: Float[Array, "*any k"]) -> Float[Array, "*any k"]:
    """Rows divided by their lengths. A zero row stays 0."""
    return v / namespace(v).clip(norm(v), TINY**0.5, None)[..., None]


def modulo_one(s: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """The parameters modulo 1, always below 1. `np.mod(-1e-17, 1.0)` is 1."""
    share = s - np.floor(s)
    return np.asarray(share * (share < 1))


def closed_steps(s: Float[Array, "*b n"]) -> Float[Array, "*b n"]:
    """s_{j+1} − s_j with s_n = s_0 + 1."""
    xp = namespace(s)
    return xp.concat([s[..., 1:], s[..., :1] + 1], axis=-1) - s


def shifted(x: Shaped[Array, "..."], by: int, axis: int = -1) -> Shaped[Array, "..."]:
    """x_{j − by} on closed curves, as by `roll`, which takes three times as long for few numbers."""
    if not is_numpy(x):
        return namespace(x).roll(x, by, axis=axis)
    count = x.shape[axis]
    start = -by % max(count, 1) - count
    return x.take(np.arange(start, start + count), axis=axis)


def distinct(numbers: Int[np.ndarray, "*_"]) -> Int[np.ndarray, " _"]:
    """The distinct ones of some integers, ascending. `np.unique` takes several times as long for many."""
    ordered = np.sort(numbers, axis=None)
    return np.asarray(ordered[np.append(True, ordered[1:] != ordered[:-1])[: len(ordered)]])


def backwards(*counts: int) -> Int[np.ndarray, " n"]:
    """Indices of closed sequences, one after the other, in the opposite direction, from the same first elements."""
    start, count = np.repeat([np.cumsum(counts) - counts, counts], counts, axis=1)
    return np.asarray(start + (start - np.arange(len(start))) % count)


def replaced(x: Shaped[Array, "b *rest"], which: Array, by: Shaped[Array, "j *rest"]) -> Shaped[Array, "b *rest"]:
    """A copy with some rows replaced."""
    copy = namespace(x).asarray(x, copy=True)
    copy[which] = by
    return copy


def indices(mask: Bool[Array, " n"]) -> Array:
    """Indices at which a mask is true."""
    return namespace(mask).nonzero(mask)[0]


def add_to_diagonal(matrix: Shaped[Array, "*b n n"], values: Any) -> None:
    """Adds to the diagonals of matrices, in place."""
    own = namespace(matrix).arange(matrix.shape[-1])
    matrix[..., own, own] += values


def add_at(total: Inexact[Array, " n"], index: Int[Array, "*any"], values: Inexact[Array, "*any"]) -> None:
    """Adds to a vector at indices, which may repeat, in place."""
    if is_numpy(total):
        np.add.at(total, index.reshape(-1), values.reshape(-1))
    else:
        total.index_add_(0, index.reshape(-1), values.reshape(-1))


def cholesky(matrix: Inexact[Array, "n n"]) -> Inexact[Array, "n n"] | None:
    """The lower Cholesky factor, from the lower triangle, or None if the matrix is not positive definite."""
    if is_numpy(matrix):
        from scipy.linalg.lapack import cpotrf, dpotrf, spotrf, zpotrf

        factor, info = {"f": spotrf, "d": dpotrf, "F": cpotrf, "D": zpotrf}[matrix.dtype.char](matrix, lower=True)
        return None if info else factor
    import torch

    factor, info = torch.linalg.cholesky_ex(matrix)
    return None if int(info) else factor


def definite_cholesky(matrix: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """`cholesky`. Raises LinAlgError if the matrix is not positive definite."""
    factor = cholesky(matrix)
    if factor is None:
        raise np.linalg.LinAlgError("a matrix is not positive definite")
    return factor


def cholesky_solve(factor: Inexact[Array, "n n"], right: Inexact[Array, "n k"]) -> Inexact[Array, "n k"]:
    """The solution x of LLᴴ x = right from a lower factor L."""
    if is_numpy(factor):
        from scipy.linalg.lapack import cpotrs, dpotrs, spotrs, zpotrs

        solve = {"f": spotrs, "d": dpotrs, "F": cpotrs, "D": zpotrs}[factor.dtype.char]
        return solve(factor, right, lower=True)[0]
    import torch

    return torch.cholesky_solve(right, factor)


def solve_lower(
    factor: Inexact[Array, "n n"], right: Inexact[Array, "n k"], *, adjoint: bool = False
) -> Inexact[Array, "n k"]:
    """The solution x of L x = right, or of Lᴴ x = right, for a lower triangle L."""
    if is_numpy(factor):
        from scipy.linalg.blas import ctrsm, dtrsm, strsm, ztrsm

        # scipy.linalg.solve_triangular takes several times as long for small matrices
        solve = {"f": strsm, "d": dtrsm, "F": ctrsm, "D": ztrsm}[factor.dtype.char]
        return solve(1.0, factor, right, lower=1, trans_a=2 if adjoint else 0)
    import torch

    matrix = factor.mH if adjoint else factor
    return torch.linalg.solve_triangular(matrix, right, upper=adjoint)


def triangular_factor(rows: Inexact[Array, "m k"]) -> Inexact[Array, "k k"]:
    """R of the QR factorisation of m ≥ k rows, in half the time of both factors."""
    if is_numpy(rows):
        return np.linalg.qr(rows, mode="r")
    import torch

    return torch.linalg.qr(rows, mode="r")[1]


def gram(rows: Inexact[Array, "m k"]) -> Inexact[Array, "k k"]:
    """Lower triangle of rowsᴴ·rows."""
    place = place_of(rows)
    if place.device is not None and place.device.type != "cpu":
        return rows.mT.conj() @ rows
    from scipy.linalg.blas import cherk, dsyrk, ssyrk, zherk

    array = to_numpy(rows)
    product: Any = {"f": ssyrk, "d": dsyrk, "F": cherk, "D": zherk}[array.dtype.char]
    # BLAS computes one triangle only: the upper one by columns, which is the lower one by rows
    by_columns = not array.flags.c_contiguous and array.flags.f_contiguous
    lower = product(1.0, array, trans=1 if is_real(array) else 2, lower=1) if by_columns else product(1.0, array.T).T
    return lower if place.device is None else place.put(lower)


def on_device_of(x: Array) -> dict[str, Any]:
    """The keyword argument `device` that creates arrays in the same place as x, empty for numpy."""
    return {} if is_numpy(x) else {"device": x.device}


def padded(x: Shaped[Array, "*any n"], before: int, after: int) -> Shaped[Array, "*any m"]:
    """Rows with `before` and `after` zeros added at their ends."""
    xp = namespace(x)
    ends = [xp.zeros((*x.shape[:-1], count), dtype=x.dtype, **on_device_of(x)) for count in (before, after)]
    return xp.concat([ends[0], x, ends[1]], axis=-1)


def contiguous(x: Array) -> Array:
    """The array, copied if it is not contiguous."""
    return np.ascontiguousarray(x) if is_numpy(x) else x.contiguous()


def zeros(shape: Sequence[int], like: Array) -> Array:
    """Zeros with the dtype and place of an array."""
    if is_numpy(like):
        return np.zeros(tuple(shape), dtype=like.dtype)
    return like.new_zeros(tuple(shape))


def arange(stop: int, like: Array, *, start: int = 0) -> Float[Array, " n"]:
    """The numbers start … stop − 1 in double precision, in the place of an array."""
    if is_numpy(like):
        return np.arange(start, stop, dtype=np.float64)
    import torch

    return torch.arange(start, stop, dtype=torch.float64, device=like.device)
