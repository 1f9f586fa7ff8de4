"""Which particles a question is about, and rows and numbers of plots that come back."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from . import asked, files
from ._deepfield import Error
from .table import Table


def numbers(name, values, expected):
    """As many numbers as are expected."""
    try:
        found = [float(value) for value in values]
    except (TypeError, ValueError):
        found = []
    if len(found) != len(expected.split(", ")) or not np.all(np.isfinite(found)):
        raise Error(f"{name}: found {values!r}, expected {expected}, finite numbers")
    return found


def _end(name, value, open_end):
    """An end of a range, None where it is open."""
    if value is None or value == open_end:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise Error(f"where: {name}: found {value!r}, expected a number or None")
    return number


def of(sphere=None, box=None, where=None, families=None, exact=False, wrap=True, time=None, at=None, radius=None):
    """The question that the native part reads."""
    shapes = []
    if sphere is not None:
        *center, reach = numbers("sphere", sphere, "x, y, z, radius")
        shapes.append({"Sphere": {"center": center, "radius": reach}})
    if box is not None:
        corners = numbers("box", box, "x0, y0, z0, x1, y1, z1")
        shapes.append({"Box": {"min": corners[:3], "max": corners[3:]}})
    if at is not None and not isinstance(at, str):
        raise Error(f"at: found {at!r:.60}, expected CATALOGUE#N such as groups.hdf5#0")
    if at is not None and sphere is not None:
        raise Error("at: found a sphere, too, expected one of them")
    if at is None and radius is not None:
        raise Error("radius: found no object, expected one that at names")
    ranges = []
    if not isinstance(where, (Mapping, type(None))):
        raise Error(f"where: found {type(where).__name__}, expected a mapping of fields to least and largest value")
    for name, ends in (where or {}).items():
        if not isinstance(ends, (tuple, list, np.ndarray)) or len(ends) != 2:
            raise Error(f"where: {name}: found {ends!r}, expected least and largest value, or None")
        ranges.append({"field": name, "min": _end(name, ends[0], -np.inf), "max": _end(name, ends[1], np.inf)})
    return {
        "region": {"shapes": shapes, "ranges": ranges, "families": asked.listed("families", families) or []},
        "at": None if at is None else files.expanded(at),
        "radius": asked.number("radius", radius, 0),
        "exact": bool(exact),
        "no_wrap": not wrap,
        "time": None if time is None else str(time),
    }


def ids_of(ids):
    """Ids as unsigned numbers of 64 bits."""
    if ids is None:
        return None
    array = np.atleast_1d(np.asarray(ids))
    if array.size == 0:
        array = array.astype(np.uint64)
    if array.ndim != 1 or array.dtype.kind not in "iu" or (array.dtype.kind == "i" and array.min() < 0):
        raise Error(f"ids: found an array of {array.dtype} of shape {array.shape}, expected whole numbers from 0 on of shape (n,)")
    return np.require(array, np.uint64, ["C", "ALIGNED"])


def table(columns, about):
    """A table of rows: families by name, ids where there are some, and numbers."""
    return Table(columns, about["units"], {"family": about["families"]}, {"exact": about["exact"]})


def edges(axis):
    """Edges of the bins along an axis."""
    ends = (axis["min"], axis["max"], axis["bins"] + 1)
    return np.geomspace(*ends) if axis["logarithmic"] else np.linspace(*ends)


@dataclasses.dataclass(frozen=True, eq=False)
class Histogram:
    """How the values of a field are distributed: ``counts`` of particles between ``edges``, and the sum of their ``weights``, where asked."""

    counts: np.ndarray
    edges: np.ndarray
    logarithmic: bool
    weights: np.ndarray | None = None
    field: str = ""
    unit: str = ""
    weight: str = "count"
    weight_unit: str = ""
    about: dict = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, eq=False)
class PhaseDiagram:
    """How the values of two fields are distributed together: ``counts`` and ``weights`` have the shape (bins of y, bins of x), as
    ``matplotlib.pyplot.pcolormesh(found.x_edges, found.y_edges, found.weights)`` takes them."""

    counts: np.ndarray
    weights: np.ndarray
    x_edges: np.ndarray
    y_edges: np.ndarray
    fields: tuple
    units: tuple
    logarithmic: tuple
    weight: str
    weight_unit: str
    about: dict


_MEANS = ("mean", "dispersion", "mass_weighted_mean", "mass_weighted_dispersion")


class Probe(dict):
    """What is in a region, as ``deepfield probe --json`` tells it; ``table`` is a :class:`Table` of it with a row for each family.

    >>> found = data.probe(where={"temperature": (0.5, None)}, fields=["temperature"])
    >>> found.table.columns[:5], found.table["family"], found.table.units["center_x"]
    (['family', 'count', 'mass', 'center_x', 'center_y'], array(['gas'], dtype='<U3'), 'kpc')
    """

    @property
    def table(self):
        """Of each family the number of particles, their mass and its centre; and of each field mean and dispersion, plain and weighted with
        mass, and the least and the largest value. What there is none of is NaN. ``about`` tells what may be in or out (``uncertain``)."""
        families, length = self["families"], self["length_unit"]
        numbers = lambda values: np.array(list(values), dtype=np.float64)
        columns = {
            "family": np.arange(len(families), dtype=np.uint16),
            "count": np.array([family["count"] for family in families], dtype=np.uint64),
            "mass": numbers(family["mass"] for family in families),
        }
        units = {"mass": self["mass_unit"]}
        for axis, name in enumerate(("center_x", "center_y", "center_z")):
            columns[name] = numbers((family["center_of_mass"] or (None,) * 3)[axis] for family in families)
            units[name] = length
        fields = [{field["name"]: field for field in family["fields"]} for family in families]
        for field, unit in {name: about["unit"] for own in fields for name, about in own.items()}.items():
            for name in (*_MEANS, "min", "max"):
                own = f"{name}_{field}".replace("-", "_")
                columns[own] = numbers(known.get(field, {}).get(name) for known in fields)
                units[own] = unit
        about = {"exact": self["exact"], "uncertain": {family["name"]: family["uncertain"] for family in families}}
        return Table(columns, units, {"family": [family["name"] for family in families]}, about)


# What is neither an axis nor in its bins.
_REST = ("total", "count", "not_positive", "outside", "missing", "exact", "error", "estimate")


def _counted(found):
    return np.array(found["counts"], dtype=np.uint64), np.array(found["weights"], dtype=np.float64)


def histogram(found):
    """A histogram of what the native part tells."""
    (axis,) = found["axes"]
    counts, weights = _counted(found)
    about = {name: found[name] for name in _REST}
    of_axis = (axis["field"], axis["unit"], found["weight"], found["weight_unit"])
    return Histogram(counts, edges(axis), axis["logarithmic"], weights, *of_axis, about)


def phase_diagram(found):
    """A phase diagram of what the native part tells."""
    x, y = found["axes"]
    counts, weights = (values.reshape(y["bins"], x["bins"]) for values in _counted(found))
    each = lambda name: (x[name], y[name])
    about = {name: found[name] for name in _REST}
    return PhaseDiagram(
        counts, weights, edges(x), edges(y), each("field"), each("unit"), each("logarithmic"), found["weight"], found["weight_unit"], about
    )


def profile(found):
    """A table of shells of what the native part tells, once for each field."""
    first = found[0]
    length, mass = first["length_unit"], first["mass_unit"]
    volume = f"({length})^3" if any(sign in length for sign in "/ ") else f"{length}^3"
    shells = first["shells"]
    columns = {
        "radius_from": [shell["from"] for shell in shells],
        "radius_to": [shell["to"] for shell in shells],
        "mass": [shell["mass"] for shell in shells],
        "density": [shell["density"] for shell in shells],
    }
    units = {"radius_from": length, "radius_to": length, "mass": mass, "density": f"{mass}/{volume}" if mass and length else ""}
    for one in found:
        for name in _MEANS if one["field"] else ():
            own = f"{name}_{one['field']}".replace("-", "_")
            # What no value is in is told as nothing.
            columns[own], units[own] = [shell[name] for shell in one["shells"]], one["field_unit"]
    columns = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    columns["count"] = np.array([shell["count"] for shell in shells], dtype=np.uint64)
    about = {name: first[name] for name in ("center", "count", "mass", "exact", "error", "estimate")}
    # Shells and masses are the same for every field, how far off its values are is not.
    about["fields"] = {one["field"]: {name: one[name] for name in ("exact", "error", "estimate")} for one in found if one["field"]}
    return Table(columns, units, about=about)
