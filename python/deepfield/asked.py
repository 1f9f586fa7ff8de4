"""What is asked, as the native part reads it."""

import json
import re

import numpy as np

from ._deepfield import Error

_FACTORS = {
    "": 1, "B": 1, "kB": 1e3, "KB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12,
    "KiB": 2**10, "M": 2**20, "MiB": 2**20, "G": 2**30, "GiB": 2**30, "T": 2**40, "TiB": 2**40,
}


def _plain(value):
    """NumPy's numbers and arrays as Python's own."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"expected a number, true, false, a name or a list, found {type(value).__name__}")


def text(asked):
    """The JSON of what is asked; what is None is not asked."""
    try:
        return json.dumps({name: value for name, value in asked.items() if value is not None}, default=_plain, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise Error(str(error)) from None


def memory(amount):
    """An amount of memory, a number of bytes or a text such as "2GiB", in bytes."""
    if amount is None:
        return None
    found = re.fullmatch(r"\s*([0-9.]+(?:[eE][0-9]+)?)\s*([A-Za-z]*)\s*", str(amount))
    if found and found[2] in _FACTORS:
        try:
            amount_bytes = int(float(found[1]) * _FACTORS[found[2]])
        except ValueError:
            amount_bytes = 0
        if 1 <= amount_bytes < 2**63:
            return amount_bytes
    raise Error(f"memory: found {amount!r}, expected an amount such as 2GiB or 512MiB")
