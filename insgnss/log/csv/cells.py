"""Cells of a CSV file as numbers."""

from __future__ import annotations

import re
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from insgnss.tables import Bool, Float64, Int64

# Cells that mean "no value"; any other cell that is not a number is a bad cell
EMPTY_CELLS: Final = ("", *"nan NaN NAN -nan na NA n/a N/A null NULL none None".split())
DECIMALS: Final = pa.decimal128(38, 18)
NUMBER: Final = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
_PLAIN: Final = r"^[+-]?\d{1,18}(\.\d{1,18})?$"  # fits ``DECIMALS``
# by the declared decimal mark: numbers with the other mark, and numbers with thousands separators
_FOREIGN: Final = {
    own: rf"^[+-]?(\d*[{other}]\d+([eE][+-]?\d+)?|\d{{1,3}}([{other}' \x{{a0}}\x{{202f}}_]\d{{3}})+([{own}]\d*)?)$"
    for own, other in (".,", ",.")
}
_INT64_MAX: Final = 2**63 - 1
_DIGITS_OF_INT64: Final = 19


def _pointed(cells: pa.Array, decimal: str) -> tuple[pa.Array, pa.Array]:
    """Return the cells with a decimal point and no leading plus, null where they are not numbers, and which are."""
    if decimal != ".":
        cells = pc.replace_substring(pc.replace_substring(cells, ".", "?"), decimal, ".")
    is_number = pc.match_substring_regex(cells, NUMBER)
    return pc.utf8_ltrim(pc.if_else(is_number, cells, None), characters="+"), is_number


def floats(cells: pa.Array, decimal: str) -> tuple[Float64, Bool]:
    """Return the cells as floats (NaN where unreadable) and which are finite numbers."""
    plain, _ = _pointed(cells, decimal)
    values = np.array(plain.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)
    finite = np.isfinite(values)
    values[~finite] = np.nan
    return values, finite


def integers(cells: pa.Array, digits: int, decimal: str) -> tuple[Int64, Bool]:
    """Return the cells in units of 10^-digits, rounded half to even, and which are numbers."""
    pointed, is_number = _pointed(cells, decimal)
    readable = is_number.to_numpy(zero_copy_only=False)
    is_plain = pc.fill_null(pc.match_substring_regex(pointed, _PLAIN), False)
    values = decimals_to_int64(pc.if_else(is_plain, pointed, "0").cast(DECIMALS), digits)
    for i in np.flatnonzero(readable & ~is_plain.to_numpy(zero_copy_only=False)):
        try:
            scaled = Decimal(pointed[int(i)].as_py()).scaleb(digits).to_integral_value(ROUND_HALF_EVEN)
        except ArithmeticError:  # an exponent beyond any date
            readable[i] = False
            continue
        if scaled.adjusted() < _DIGITS_OF_INT64:
            values[i] = min(max(int(scaled), -_INT64_MAX), _INT64_MAX)
        elif scaled:  # beyond it anyway: an integer of a million digits would take a second to write out
            values[i] = _INT64_MAX if scaled > 0 else -_INT64_MAX
    return values, readable


def decimals_to_int64(cells: pa.Array, digits: int) -> Int64:
    """Return decimal cells in units of 10^-digits, rounded half to even; beyond 64 bits the largest integer."""
    rounded = pc.round(cells, ndigits=digits, round_mode="half_to_even").cast(pa.decimal128(38, digits))
    words = np.frombuffer(rounded.buffers()[1], np.int64).reshape(-1, 2)[rounded.offset :][: len(rounded)]
    low, high = words[:, 0], words[:, 1]
    return np.where(high == low >> 63, low, np.where(high < 0, -_INT64_MAX, _INT64_MAX))


def are_foreign(cells: pa.Array, decimal: str) -> Bool:
    """Return which cells are numbers with another decimal mark, or with thousands separators."""
    foreign: Bool = pc.match_substring_regex(cells, _FOREIGN[decimal]).to_numpy(zero_copy_only=False)
    return foreign


def foreign_advice(cell: str, decimal: str) -> tuple[str, str]:
    """Return message and advice for a number of ``are_foreign``."""
    if decimal == "," and re.match(NUMBER, cell):
        message = f"'{cell}' has a decimal point, and the flight file declares decimal = ','"
        return message, "leave out 'decimal', or write the file with one decimal mark throughout"
    return (
        f"'{cell}' holds a decimal comma or a thousands separator",
        "for decimal commas write decimal = ',' beside 'columns' in the flight file (in [imu], [gnss] or"
        " [reference]); thousands separators cannot be read: write the file with a decimal point alone",
    )
