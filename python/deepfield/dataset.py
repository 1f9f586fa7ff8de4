"""Open data: what it holds."""

import dataclasses
import json
import os

import numpy as np

from . import _deepfield, asked, files, notes, progress as progresses, questions
from .drawing import Drawn
from .particles import Particles
from .questions import Histogram
from .samples import Samples


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


class Data(Drawn, Particles, Samples):
    """Open data.

    ``kind`` is ``particles``, ``run``, ``image``, ``volume``, ``heights`` or ``mixed``; ``families`` are by name; ``bounds`` are the smallest
    and the largest coordinates, (2, 3), in ``unit``; ``modes`` are the visualization modes that draw it, ``attributes`` what can give the hue;
    ``scene`` is the scene file that it was opened from. ``mixed`` data, which is not of particles alone, has no families, fields, modes and bounds.
    """

    def __init__(self, native, scene=None):
        about = json.loads(native.about)
        self._native = native
        self._said = json.loads(native.said)
        self.scene = scene
        self.paths = native.paths
        self.kind = about["kind"]
        self.unit = about["unit"]
        self.mass_unit = about.get("mass_unit", "")
        self.count = about.get("count")
        self.shape = tuple(about.get("shape", ()))
        self.bounds = _corners(about["bounds"])
        self.time, self.redshift, self.box_size = (about.get(name) for name in ("time", "redshift", "box_size"))
        self.steps = np.array(about["steps"]) if about.get("steps") else None
        self.notes = about.get("notes", [])
        self.modes = about.get("modes", [])
        # Files that pictures of it are not written over: it, and what it was built of.
        named = [one.get(name) for one in self._said for name in ("texture", "before")]
        read = (*self.paths, about.get("source"), scene and scene.path, *named)
        self._read = [files.whole_path(path) for path in read if path]
        slices = [path for path in self._read if self.kind == "volume" and os.path.isdir(path)]
        self._read += [entry.path for folder in slices for entry in os.scandir(folder)]
        self.families = {found["name"]: _family(found) for found in about["families"]}
        fields = (name for family in self.families.values() for name in family.fields)
        self.attributes = about.get("attributes") or list(dict.fromkeys(fields))

    def __reduce__(self):
        """Copies, and those that are sent to other processes of this machine, are opened there."""
        return _again, (self.paths, self._said, self.scene, self._native.memory)

    def __repr__(self):
        names = ", ".join(os.path.basename(path) for path in self.paths)
        lines = [f"<{names}: {self.kind}"]
        if self.count is not None:
            shape = f" ({' x '.join(str(side) for side in self.shape)})" if self.shape else ""
            lines[0] += f", {_spaced(self.count)}{shape}"
        if self.steps is not None:
            lines[0] += f", {len(self.steps)} steps"
        if self.bounds is not None:
            # Heights have a unit of their own, and images no depth.
            axes = 2 if self.kind in ("heights", "image") else 3
            sides = " x ".join(f"{side:.4g}" for side in (self.bounds[1] - self.bounds[0])[:axes])
            lines[0] += f", {sides}{' ' + self.unit if self.unit else ''}"
        width = max((len(name) for name in self.families), default=0)
        for family in self.families.values():
            lines.append(f"  {family.name:<{width}}  {_spaced(family.count)}: {', '.join(family.fields)}")
        return "\n".join(lines) + ">"


def read(paths, wanted, scene=None, progress=None, threads=None, memory=None, *, stacklevel=4):
    """Data as it is wanted, opened; notes are told where the package was called."""
    with progresses.teller(progress) as tell:
        native, told = _deepfield.open(paths, asked.text(wanted), threads, memory, tell)
    notes.tell(told, stacklevel)
    return Data(native, scene)


def _again(paths, said, scene, memory):
    """Data that was open elsewhere."""
    return read(paths, {"datasets": said}, scene, memory=memory)


def _histogram(found):
    if not found or not found["counts"]:
        return None
    counts = np.array(found["counts"], dtype=np.uint64)
    return Histogram(counts, questions.edges({**found, "bins": len(counts)}), found["logarithmic"])


def _field(found):
    numbers = [found.get(name) for name in ("min", "max", "mean")]
    return Field(found["name"], found["unit"], *numbers, found.get("missing", 0), _histogram(found.get("histogram")))


def _family(found):
    fields = {field["name"]: _field(field) for field in found["fields"]}
    return Family(found["name"], found["count"], found.get("mass"), _corners(found["bounds"]), fields)


def _corners(bounds):
    return None if bounds is None else np.array(bounds)


def _spaced(count):
    return f"{count:,}".replace(",", " ")
