"""Open data: what it holds, pictures of it, and what is in a region."""

import dataclasses
import io
import json
import os

import numpy as np

from . import _deepfield, asked, notes
from .camera import Camera
from .picture import Picture


@dataclasses.dataclass(frozen=True, eq=False)
class Histogram:
    """How the values of a field are distributed over its source particles."""

    counts: np.ndarray
    edges: np.ndarray
    logarithmic: bool


@dataclasses.dataclass(frozen=True, eq=False)
class Field:
    """A field of a family: its unit, and its range, mean and histogram over all source particles where they are known."""

    name: str
    unit: str
    min: float | None
    max: float | None
    mean: float | None
    missing: int
    histogram: Histogram | None

    def __repr__(self):
        known = "" if self.min is None else f" {self.min:.4g} to {self.max:.4g}, mean {self.mean:.4g}"
        return f"<{self.name}{known}{' ' + self.unit if self.unit else ''}>"


@dataclasses.dataclass(frozen=True, eq=False)
class Family:
    """A layer of the data."""

    name: str
    count: int
    mass: float | None
    bounds: np.ndarray | None
    fields: dict

    def __repr__(self):
        return f"<{self.name}: {_spaced(self.count)}, {', '.join(self.fields)}>"


def paths_of(path):
    """Paths of one or of several."""
    return [os.fspath(path)] if isinstance(path, (str, os.PathLike)) else [os.fspath(one) for one in path]


def open(path, progress=None):
    """Opens a source, a page file or a run; or a list of them, to be shown together.

    A source of particles is built into the user's cache first, where the program finds it, too, unless it is there already. ``progress`` is
    called with the stage, the steps done and their number.
    """
    native, told = _deepfield.open(paths_of(path), progress)
    notes.tell(told)
    return Data(native)


def _histogram(found):
    if not found or not found["counts"]:
        return None
    counts = np.array(found["counts"], dtype=np.uint64)
    ends = (found["min"], found["max"], len(counts) + 1)
    edges = np.geomspace(*ends) if found["logarithmic"] else np.linspace(*ends)
    return Histogram(counts, edges, found["logarithmic"])


def _field(found):
    numbers = [found.get(name) for name in ("min", "max", "mean")]
    return Field(found["name"], found["unit"], *numbers, found.get("missing", 0), _histogram(found.get("histogram")))


def _family(found):
    fields = {field["name"]: _field(field) for field in found["fields"]}
    return Family(found["name"], found["count"], found.get("mass"), _corners(found["bounds"]), fields)


def _corners(bounds):
    return None if bounds is None else np.array(bounds)


class Data:
    """Open data.

    ``kind`` is ``particles``, ``run``, ``image``, ``volume``, ``heights`` or ``mixed``; ``families`` are by name; ``bounds`` are the smallest
    and the largest coordinates, (2, 3), in ``unit``.
    """

    def __init__(self, native):
        about = json.loads(native.about)
        self._native = native
        self.paths = [os.fspath(path) for path in native.paths]
        self.kind = about["kind"]
        self.unit = about["unit"]
        self.mass_unit = about.get("mass_unit", "")
        self.count = about.get("count")
        self.shape = tuple(about.get("shape", ()))
        self.bounds = _corners(about["bounds"])
        self.time, self.redshift, self.box_size = (about.get(name) for name in ("time", "redshift", "box_size"))
        self.steps = np.array(about["steps"]) if about.get("steps") else None
        self.notes = about.get("notes", [])
        self.families = {found["name"]: _family(found) for found in about["families"]}

    def __repr__(self):
        names = ", ".join(os.path.basename(path) for path in self.paths)
        lines = [f"<{names}: {self.kind}"]
        if self.count is not None:
            shape = f" ({' x '.join(str(side) for side in self.shape)})" if self.shape else ""
            lines[0] += f", {_spaced(self.count)}{shape}"
        if self.steps is not None:
            lines[0] += f", {len(self.steps)} steps"
        if self.bounds is not None:
            sides = " x ".join(f"{side:.4g}" for side in self.bounds[1] - self.bounds[0])
            lines[0] += f", {sides}{' ' + self.unit if self.unit else ''}"
        width = max((len(name) for name in self.families), default=0)
        for family in self.families.values():
            lines.append(f"  {family.name:<{width}}  {_spaced(family.count)}: {', '.join(family.fields)}")
        return "\n".join(lines) + ">"

    def render(
        self,
        camera=None,
        size=None,
        mode=None,
        attribute=None,
        exact=False,
        error_px=None,
        *,
        family=None,
        transfer=None,
        background=None,
        time=None,
        memory=None,
        config=None,
        progress=None,
        **settings,
    ):
        """A picture, converged.

        ``camera`` is a Camera or a mapping with ``eye``, ``target``, ``up`` and ``fov`` or ``ortho``; without it all of the data is in view.
        ``size`` is width and height [1200 x 800], ``mode`` a visualization mode, ``attribute`` what gives the hue, ``error_px`` the largest
        displacement of a particle on screen [0.8]; ``exact`` draws every source particle at full precision. ``transfer`` is the name of a
        preset or a file, ``background`` "black", "transparent" or "#rrggbb", ``time`` when of a run ("step:12", "z:1.5", "last"). ``config``
        is a file or a text in RON, as ``deepfield render --config`` reads it. All other names are settings of the mode, with underscores for
        hyphens; ``deepfield modes`` lists them.
        """
        wanted = {
            "camera": Camera.of(camera).asked(),
            "size": None if size is None else [int(side) for side in size],
            "mode": mode,
            "attribute": attribute,
            "exact": bool(exact),
            "error_px": error_px,
            "family": family,
            "transfer": None if transfer is None else os.fspath(transfer),
            "background": background,
            "time": None if time is None else str(time),
            "memory": asked.memory(memory),
            "settings": {name.replace("_", "-"): value for name, value in settings.items()},
            **_config(config),
        }
        native, told = self._native.render(asked.text(wanted), progress)
        notes.tell(told)
        return Picture(native, told)

    def probe(
        self,
        sphere=None,
        box=None,
        where=None,
        families=None,
        *,
        fields=None,
        shells=None,
        shell_field=None,
        exact=False,
        wrap=True,
        time=None,
        progress=None,
    ):
        """Sums over all particles in a region, as ``deepfield probe --json`` tells them.

        ``sphere`` is (x, y, z, radius), ``box`` (x0, y0, z0, x1, y1, z1), ``where`` a mapping of fields to (least, largest), either of which
        may be None; ``families`` names some. With several a particle has to be within all of them. ``shells`` are those of a radial profile
        in the sphere. Of a page file the answer says how far off it may be; ``exact`` asks the source that it was built from.
        """
        shapes = []
        if sphere is not None:
            x, y, z, radius = sphere
            shapes.append({"Sphere": {"center": [x, y, z], "radius": radius}})
        if box is not None:
            x0, y0, z0, x1, y1, z1 = box
            shapes.append({"Box": {"min": [x0, y0, z0], "max": [x1, y1, z1]}})
        ranges = [{"field": name, "min": least, "max": most} for name, (least, most) in (where or {}).items()]
        wanted = {
            "region": {"shapes": shapes, "ranges": ranges, "families": list(families or ())},
            "fields": None if fields is None else list(fields),
            "shells": shells,
            "shell_field": shell_field,
            "exact": bool(exact),
            "no_wrap": not wrap,
            "time": None if time is None else str(time),
        }
        found, told = self._native.probe(asked.text(wanted), progress)
        notes.tell(told)
        return json.loads(found)


def _spaced(count):
    return f"{count:,}".replace(",", " ")


def _config(config):
    """A configuration by its text, with what messages call it."""
    if config is None:
        return {}
    if isinstance(config, str) and config.lstrip().startswith("("):
        return {"config": config, "config_name": "config"}
    path = os.fspath(config)
    try:
        with io.open(path, encoding="utf-8") as file:
            return {"config": file.read(), "config_name": path}
    except OSError as error:
        raise _deepfield.Error(f"{path}: {error.strerror}") from None
