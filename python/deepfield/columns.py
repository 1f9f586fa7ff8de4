"""Arrays as columns of particles: floats in the machine's order of bytes, with their units."""

import os
from collections.abc import Mapping

import numpy as np

from ._deepfield import Error

# How packages name what has no unit.
_NO_UNITS = {"", "1", "1.0", "dimensionless", "None", "NoUnit()", "(dimensionless)"}

# Kinds of types whose values are numbers.
_NUMBERS = "biuf"


def unit_of(value):
    """The unit that an array says of itself: `units` of unyt and pynbody, `unit` of astropy. Empty where it says none."""
    for name in ("units", "unit"):
        unit = getattr(value, name, None)
        if unit is not None and not callable(unit):
            return "" if str(unit) in _NO_UNITS else str(unit)
    return ""


def floats(name, value):
    """The values as 32-bit or 64-bit floats: what has these already is not copied, unless it lies between other fields of packed rows."""
    if isinstance(value, np.ma.MaskedArray):
        value = value.astype(np.float64).filled(np.nan)
    array = np.asarray(value)
    if array.dtype in (np.float32, np.float64) and array.dtype.isnative:
        # The native part counts steps in values.
        is_readable = array.flags.aligned and not any(step % array.itemsize for step in array.strides)
        return array if is_readable else array.copy()
    if array.dtype.kind not in _NUMBERS:
        raise Error(f"{name}: found an array of {array.dtype}, expected numbers")
    wide = np.float32 if array.dtype.kind == "f" and array.dtype.itemsize <= 4 else np.float64
    return array.astype(wide)


def of_structured(family, source, told):
    """The columns of a structured array as a mapping; whatever else as it is. A table has columns that nobody has chosen: those of texts and
    other values that are no numbers are left out, which is ``told``."""
    names = source.dtype.names if isinstance(source, np.ndarray) else None
    if not names:
        return source
    kinds = {name: source.dtype[name].base for name in names}
    others = [name for name, kind in kinds.items() if kind.names is None and kind.kind not in _NUMBERS]
    told += [f"{family}: {name}: left out: found an array of {kinds[name]}, expected numbers" for name in others]
    return {name: source[name] for name in names if name not in others}


def files_of(families):
    """The files that the arrays of families are mapped from."""
    for array in (array for fields in families.values() for array in fields.values()):
        while isinstance(array, np.ndarray):
            name = getattr(array, "filename", None)
            if isinstance(name, (str, os.PathLike)):
                yield name
            array = array.base


def left_out(found):
    """What there is to tell of columns that are no attributes, for their shape."""
    several = ((family, name, array.shape) for family, name, _, array in found if array.ndim == 2)
    return [
        f"{family}: {name}: left out: found shape {shape}, expected (n,) or (n, 3)"
        for family, name, shape in several
        if shape[1] not in (1, 3) and shape[0] > 0
    ]


def columns(families, units):
    """Columns of families, each with its family's name, its own name, its unit and its array. A single number is every particle's."""
    known = {name: None for fields in families.values() for name in fields}
    for name, unit in units.items():
        if name not in known:
            raise Error(f"units: found {name}, expected one of {', '.join(known)}")
        if isinstance(unit, Mapping):
            raise Error(f"units: {name}: found a mapping, expected the unit of a column: those of all families are the same")
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
