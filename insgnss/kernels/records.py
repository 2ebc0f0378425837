"""Records: the fields of a structured array, written once as a class that mypy checks.

    class Fix(Record):
        t_ns: int  # int64
        r_e: Annotated[Float64, 3]  # three float64
        status: Annotated[int, np.int8]  # narrower than the class says

    FIX_DTYPE: Final = dtype_of(Fix)

An element of such an array is a ``np.record``; the class is its description and is never made.
"""

from __future__ import annotations

import typing
from typing import Any, Self

import numpy as np
import numpy.typing as npt

_NUMBERS = {int: np.int64, float: np.float64}


class Record:
    """An element of a structured array, whose fields a class beneath names."""

    def __getitem__(self, name: str) -> Any:
        """Return the field of a name."""
        raise NotImplementedError

    def __setitem__(self, name: str, value: npt.ArrayLike) -> None:
        """Write the field of a name."""
        raise NotImplementedError

    def copy(self) -> Self:
        """Return the same values in memory of their own."""
        raise NotImplementedError


def dtype_of(record: type[Record], *, align: bool = False) -> np.dtype[Any]:
    """Return the type of the elements that a class describes, its fields in their order.

    A field is an int, a float or an array; what follows in ``Annotated`` is a narrower type, then the array's shape.
    """
    fields: list[Any] = []
    for name, hint in typing.get_type_hints(record, include_extras=True).items():
        base, *more = typing.get_args(hint) if typing.get_origin(hint) is typing.Annotated else (hint,)
        if more and not isinstance(more[0], int):
            kind, *shape = more
        else:
            kind, shape = _NUMBERS.get(base) or _element_of(base), more
        fields.append((name, kind, tuple(shape)))
    return np.dtype((np.record, np.dtype(fields, align=align)))


def _element_of(array: Any) -> Any:
    """Return the type of an array's elements, out of that of the array.

    ``NDArray[t]`` has the argument t from NumPy 2.5 on; before it is ``ndarray[shape, dtype[t]]``.
    """
    kind = typing.get_args(array)[-1]
    return next(iter(typing.get_args(kind)), kind)
