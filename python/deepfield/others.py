"""Objects of pynbody, yt and swiftsimio as families of arrays; none of these packages is needed."""

import os
import re

import numpy as np

from ._deepfield import Error

_PACKAGES = ("pynbody", "yt", "swiftsimio")

# Families by the names that these packages have for them; others keep theirs.
_FAMILIES = {
    "dm": "dark", "star": "stars", "bh": "black-holes", "dark-matter": "dark", "darkmatter": "dark",
    "parttype0": "gas", "parttype1": "dark", "parttype2": "type2", "parttype3": "type3", "parttype4": "stars",
    "parttype5": "black-holes", "halo": "dark", "disk": "type2", "bulge": "type3", "bndry": "black-holes",
}  # fmt: skip

# Attributes that are kept where none is named, with the names that they may have.
_USUAL = {
    "temperature": ("temp", "temperatures", "Temperature"),
    "internal-energy": ("u", "internal_energies", "InternalEnergy"),
    "metallicity": ("metals", "metal_mass_fractions", "Metallicity"),
}

# The support radius of SWIFT's kernels in units of its smoothing length (Dehnen and Aly 2012, table 1).
_GAMMA = {
    "quartic": 2.018932, "quintic": 2.195775, "wendland c2": 1.936492, "wendland-c2": 1.936492, "wendland c4": 2.207940,
    "wendland-c4": 2.207940, "wendland c6": 2.449490, "wendland-c6": 2.449490,
}  # fmt: skip
_CUBIC = 1.825742

# The support radius in units of what pynbody has of such files; none of SWIFT's, whose kernel it does not tell.
_SUPPORT = {"SwiftSnap": None, "GadgetHDFSnap": 1.0, "GadgetSnap": 1.0, "TipsySnap": 2.0, "NchiladaSnap": 2.0}


def package_of(source):
    """The package that an object belongs to, one of three; None of others."""
    names = (kind.__module__.partition(".")[0] for kind in type(source).__mro__)
    return next((name for name in names if name in _PACKAGES), None)


def files_of(source):
    """The file that an object was opened from, as far as it says so."""
    of = {"pynbody": "ancestor", "yt": "ds", "swiftsimio": "metadata"}.get(package_of(source))
    name = of and getattr(getattr(source, of, source), "filename", None)
    return [name] if isinstance(name, (str, os.PathLike)) else []


def arrays_of(source, attributes=None, families=None):
    """Families of arrays, their units by family and name, and what is said of them all: ``box_size`` and ``redshift``, where it is known.

    ``attributes`` and ``families`` are read, the usual ones and all where none is named. Lengths that have a unit of yt's own become kpc,
    masses solar ones, velocities km/s.
    """
    found, said = {"pynbody": _pynbody, "yt": _yt, "swiftsimio": _swiftsimio}[package_of(source)](source)
    arrays, units, absent = {}, {}, set(attributes or ())
    for family, fields in found:
        if families is not None and family not in families:
            continue
        # Fields are read here, so that no more are than are asked for.
        own = {name: fields(*names) for name, names in _columns(attributes)}
        own = {name: value for name, value in own.items() if value is not None}
        absent -= {"speed"} if "velocities" in own else set()
        absent -= set(own)
        if "positions" not in own or not len(own["positions"]):
            continue
        arrays[family] = own
    if absent:
        raise Error(f"attributes: found {min(absent)}, expected one that {type(source).__name__} has")
    if not arrays:
        raise Error(f"{type(source).__name__}: found no particles, expected some")
    for name in {name for own in arrays.values() for name in own}:
        units[name] = next(_unit(own[name]) for own in arrays.values() if name in own)
    box = said.get("box_size")
    corners = [extreme(own["positions"]) for own in arrays.values() for extreme in (np.min, np.max)]
    if box is not None and not 0.0 <= min(map(float, corners)) <= max(map(float, corners)) <= box:
        # A box that begins elsewhere is not one that repeats from 0 on.
        said.pop("box_size")
    return arrays, units, said


def _columns(attributes):
    """Names of columns, and those under which they are looked for, the first that is there."""
    yield "positions", ("positions",)
    yield "mass", ("mass",)
    if attributes is None or "speed" in attributes:
        yield "velocities", ("velocities",)
    yield "smoothing_length", ("smoothing_length",)
    yield "density", ("density",)
    for name in _USUAL if attributes is None else attributes:
        if name != "speed":
            yield name, (name, name.replace("-", "_"), *_USUAL.get(name, ()))


def _family(name):
    name = re.sub(r"[^a-z0-9]+", "-", str(name).lower()).strip("-")
    return _FAMILIES.get(name, name)


def _unit(array):
    """The unit of an array, with powers as ``a^2`` and the scale factor before what it scales."""
    unit = getattr(array, "units", None)
    text = "" if unit is None else re.sub(r"\bMsol\b", "Msun", _written_out(unit))
    if text in ("", "1", "1.00e+00", "dimensionless", "code_metallicity", "NoUnit()"):
        return ""
    if " " in text or "**" in text and "/" not in text.replace("**", ""):
        text = _in_line(text)
    factor = "a " if getattr(array, "comoving", False) and re.fullmatch(r"[kMG]?pc|[kcm]?m", text) else ""
    return factor + text.replace("**", "^")


def _written_out(unit):
    """The text of a unit with all digits of its number, of which pynbody shows three."""
    scale = getattr(unit, "_scale", None)
    number, _, rest = str(unit).partition(" ")
    is_rounded = isinstance(scale, float) and re.fullmatch(r"\d\.\d\de[+-]\d+", number)
    return f"{scale:.10g} {rest}".rstrip().replace("e+", "e") if is_rounded else str(unit)


def _in_line(text):
    """pynbody's product of powers, ``kpc a h**-1``, as ``a kpc/h``."""
    above, below = [], []
    for part in re.sub(r"\b(\d+)\.0*e\+", r"\1e", text).split():
        base, _, power = part.partition("**")
        is_below = power.startswith("-")
        # `a^1/2 km` would be a number of kilometres, 2, that something is divided by.
        power = re.sub(r"^(\d+)/(\d+)$", lambda found: f"{int(found[1]) / int(found[2]):g}", power.removeprefix("-"))
        (below if is_below else above).append(base if power in ("", "1") else f"{base}^{power}")
    above.sort(key=lambda part: part.partition("^")[0] != "a")
    return "/".join([" ".join(above) or "1", *below])


def _first(has, get):
    """What reads the first of some fields that there is, None where there is none."""

    def read(*names):
        name = next((name for name in names if has(name)), None)
        return None if name is None else get(name)

    return read


def _pynbody(snapshot):
    own = {"positions": "pos", "velocities": "vel", "density": "rho", "smoothing_length": "smooth"}
    kinds = (kind.__name__ for kind in type(snapshot.ancestor).__mro__)
    support = next((_SUPPORT[name] for name in kinds if name in _SUPPORT), None)
    if getattr(snapshot.ancestor, "_kdtree_derived_smoothing", False):
        support = 2.0

    def fields(part):
        # Derived arrays would be worked out.
        known = {*part.keys(), *part.loadable_keys()}

        def read(*names):
            value = _first(known.__contains__, part.__getitem__)(*(own.get(name, name) for name in names))
            if names != ("smoothing_length",) or value is None or support == 1.0:
                return value
            return None if support is None else support * value

        return read

    said, about = {}, snapshot.properties
    if about.get("a"):
        said["redshift"] = 1.0 / float(about["a"]) - 1.0
    box = about.get("boxsize")
    if hasattr(box, "in_units"):
        said["box_size"] = float(box.in_units(snapshot["pos"].units, **snapshot.conversion_context()))
    return [(_family(family.name), fields(snapshot[family])) for family in snapshot.families()], said


def _swiftsimio(data):
    about = data.metadata
    # Initial states lack what a run says of itself.
    kernel = (getattr(about, "hydro_scheme", None) or {}).get("Kernel function", b"")
    kernel = (kernel.decode() if isinstance(kernel, bytes) else str(kernel)).lower()
    gamma = next((gamma for name, gamma in _GAMMA.items() if name in kernel), _CUBIC)
    own = {
        "positions": "coordinates", "mass": "masses", "smoothing_length": "smoothing_lengths", "density": "densities",
    }  # fmt: skip

    def fields(part, known):
        def read(*names):
            value = _first(known.__contains__, lambda name: getattr(part, name))(*(own.get(name, name) for name in names))
            # Columns with names of their own are not one attribute.
            if value is None or not hasattr(value, "units"):
                return None
            value = _plain(value)
            return gamma * value if names == ("smoothing_length",) else value

        return read

    groups = [(name, getattr(data, name), getattr(about, f"{name}_properties").field_names) for name in about.present_group_names]
    redshift = getattr(about, "redshift", None)
    said = {} if redshift is None else {"redshift": float(np.atleast_1d(redshift)[0])}
    places = next((part.coordinates.units for _, part, known in groups if "coordinates" in known), None)
    box = np.atleast_1d(about.boxsize)
    if places is not None and np.all(box == box[0]):
        said["box_size"] = float(box[0].to(_usual(places)).value)
    return [(_family(name), fields(part, known)) for name, part, known in groups], said


def _yt(source):
    dataset = getattr(source, "ds", source)
    region = source.all_data() if source is dataset else source
    own = {
        "positions": "particle_position", "velocities": "particle_velocity", "mass": "particle_mass",
    }  # fmt: skip
    known = {*dataset.field_list, *dataset.derived_field_list}

    def fields(kind):
        def read(*names):
            # Fields of the grid that yt makes of particles are no particles' own.
            names = [name for asked in names for name in (own.get(asked, asked), f"particle_{asked}")]
            value = _first(lambda name: (kind, name) in known, lambda name: region[kind, name])(*names)
            return None if value is None else _plain(value)

        return read

    said = {}
    if getattr(dataset, "cosmological_simulation", False):
        said["redshift"] = float(dataset.current_redshift)
    width, left = (_plain(edge) for edge in (dataset.domain_width, dataset.domain_left_edge))
    if all(dataset.periodicity) and np.allclose(width, width[0]) and not np.any(left):
        said["box_size"] = float(width[0])
    return [(_family(kind), fields(kind)) for kind in dataset.particle_types_raw], said


def _usual(units):
    """A unit that is one word, as others read it."""
    # The codes' own units, and powers of them, have no meaning outside.
    if re.fullmatch(r"[A-Za-z]+(/[A-Za-z]+)?", str(units)):
        return str(units)
    for usual in ("kpc", "Msun", "km/s", "km**2/s**2", "Msun/kpc**3", "K"):
        if units.same_dimensions_as(type(units)(usual)):
            return usual
    return None


def _plain(array):
    usual = _usual(array.units)
    return array if usual is None or usual == str(array.units) else array.to(usual)
