"""Arrays as columns of particles: floats in the machine's order of bytes, with their units."""

import numpy as np

from ._deepfield import Error

# How packages name what has no unit.
_NO_UNITS = {"", "1", "1.0", "dimensionless", "None", "NoUnit()", "(dimensionless)"}


def unit_of(value):
    """The unit that an array says of itself: `units` of unyt and pynbody, `unit` of astropy. Empty where it says none."""
    for name in ("units", "unit"):
        unit = getattr(value, name, None)
        if unit is not None and not callable(unit):
            return "" if str(unit) in _NO_UNITS else str(unit)
    return ""


def floats(name, value):
    """The values as 32-bit or 64-bit floats: what has these already is not copied."""
    if isinstance(value, np.ma.MaskedArray):
        value = value.astype(np.float64).filled(np.nan)
    array = np.asarray(value)
    if array.dtype in (np.float32, np.float64) and array.dtype.isnative:
        return array
    if array.dtype.kind not in "biuf":
        raise Error(f"{name}: found an array of {array.dtype}, expected numbers")
    wide = np.float32 if array.dtype.kind == "f" and array.dtype.itemsize <= 4 else np.float64
    return array.astype(wide)


def columns(families, units):
    """Columns of families, each with its family's name, its own name, its unit and its array. A single number is every particle's."""
    found = []
    for family, fields in families.items():
        arrays = {name: floats(f"{family}: {name}", value) for name, value in fields.items()}
        count = max((len(array) for array in arrays.values() if array.ndim > 0), default=0)
        for name, array in arrays.items():
            if array.ndim == 0:
                array = np.broadcast_to(array, (count,))
            unit = units.get(name)
            found.append((family, name, unit_of(fields[name]) if unit is None else str(unit), array))
    return found
