"""What is asked, as the native part reads it."""

import json

import numpy as np

from ._deepfield import Error, bytes as _bytes


def _plain(value):
    """NumPy's numbers and arrays as Python's own, and objects as what they say."""
    if hasattr(value, "asked"):
        return value.asked()
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"expected a number, true, false, a name or a list, found {type(value).__name__}")


def text(asked):
    """The JSON of what is asked; what is None is not asked."""
    try:
        return json.dumps({name: value for name, value in asked.items() if value is not None}, default=_plain, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise Error(str(error)) from None


def names(several):
    """Names with commas between them, of a text of them or of an iterable."""
    if several is None or isinstance(several, str):
        return several
    return ",".join(str(name) for name in several)


def memory(amount):
    """An amount of memory, a number of bytes or a text such as "2GiB", in bytes."""
    if amount is None:
        return None
    return _bytes(str(amount))


def size(sides):
    """Width and height."""
    try:
        width, height = (int(side) for side in sides)
    except (TypeError, ValueError):
        raise Error(f"size: found {sides!r}, expected width and height") from None
    return [width, height]


def whole(name, count, most, least=1):
    """A whole number from ``least`` on; None is not asked."""
    if count is not None and (isinstance(count, bool) or not isinstance(count, (int, np.integer)) or not least <= count <= most):
        raise Error(f"{name}: found {count!r}, expected a whole number from {least} to {most}")
    return None if count is None else int(count)


def threads(count):
    """A number of threads; None leaves it to the machine."""
    return whole("threads", count, 1024)
