"""What is asked, as the native part reads it."""

import json
import math

import numpy as np

from ._deepfield import Error, bytes as _bytes


def _plain(value):
    """NumPy's numbers and arrays as Python's own, and objects as what they say."""
    if hasattr(value, "asked"):
        return value.asked()
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"expected a number, true, false, a name or a list, found {type(value).__name__}")


def _json(name, value):
    """The JSON of what is asked by a name."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(own))}: {_json(own, one)}" for own, one in value.items()) + "}"
    try:
        return json.dumps(value, default=_plain, allow_nan=False)
    except TypeError as error:
        raise Error(f"{name}: {error}") from None
    except ValueError:
        raise Error(f"{name}: found {value!r}, expected finite numbers") from None


def text(asked):
    """The JSON of what is asked; what is None is not asked."""
    return _json("", {name: value for name, value in asked.items() if value is not None})


def names(field, several):
    """Names with commas between them, of a text of them or of an iterable; None is not asked."""
    return several if several is None or isinstance(several, str) else ",".join(listed(field, several))


def listed(field, several):
    """Names that a field is asked for, of a text of one or of several with commas between them, or of an iterable; None is not asked."""
    if several is None:
        return None
    if isinstance(several, str):
        return [name.strip() for name in several.split(",")]
    try:
        return [str(name) for name in several]
    except TypeError:
        raise Error(f"{field}: found {several!r:.60}, expected a name, or a list of names") from None


def memory(amount):
    """An amount of memory, a number of bytes or a text such as "2GiB", in bytes."""
    if amount is None:
        return None
    return _bytes(str(amount))


def size(sides):
    """Width and height."""
    try:
        found = list(sides)
        width, height = (int(side) for side in found)
        is_whole = [width, height] == found
    except (TypeError, ValueError, OverflowError):
        is_whole = False
    if not is_whole:
        raise Error(f"size: found {sides!r}, expected width and height, whole numbers of pixels")
    return [width, height]


def whole(name, count, most, least=1):
    """A whole number from ``least`` on; None is not asked."""
    if count is not None and (isinstance(count, bool) or not isinstance(count, (int, np.integer)) or not least <= count <= most):
        raise Error(f"{name}: found {count!r}, expected a whole number from {least} to {most}")
    return None if count is None else int(count)


def count(name, value):
    """A whole number from 0 on, of whatever type."""
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    if not is_number or not 0 <= value < np.inf or int(value) != value:
        raise Error(f"{name}: found {value!r}, expected a whole number from 0 on")
    return int(value)


def number(name, value, least=-math.inf):
    """A finite number greater than ``least``; None is not asked."""
    if value is None:
        return None
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not least < found < math.inf:
        raise Error(f"{name}: found {value!r}, expected a number" + (f" greater than {least}" if least > -math.inf else ""))
    return found


def threads(count):
    """A number of threads; None leaves it to the machine."""
    return whole("threads", count, 1024)
