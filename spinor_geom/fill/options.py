"""How patches meet the mesh: their tangents turn at the rim ("C0"), or go on ("C1"); cheap to import."""

import math
import sys
from numbers import Real
from typing import Any, Literal, TypeAlias, get_args

from spinor_geom.errors import OptionError

Continuity: TypeAlias = Literal["C0", "C1"]

CONTINUITY: tuple[Continuity, ...] = get_args(Continuity)


def require_positive(name: str, value: Any, *, finite: bool = True, instead: str = "") -> None:
    """Raises an OptionError for a value that is not a positive number; `instead` says what else it may be."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 < value <= (sys.float_info.max if finite else math.inf):
        raise OptionError(f"{name} must be {instead}a positive number, not {value!r}")
