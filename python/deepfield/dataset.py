"""Open data: what it holds, pictures of it, and what is in a region."""

import contextlib
import dataclasses
import json
import os

import numpy as np

from . import _deepfield, asked, files, notes, progress as progresses, questions
from .camera import Camera
from .objects import Scene, TransferFunction
from .picture import Picture
from .questions import Histogram


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


def paths_of(source, expected="a path or a list of paths"):
    """Paths of one or of several."""
    if isinstance(source, (str, os.PathLike)):
        return [os.fspath(source)]
    with contextlib.suppress(TypeError):
        # Rows and columns are no paths, though the latter may have names.
        if getattr(source, "ndim", 1) == 1:
            return [os.fspath(one) for one in source]
    raise _deepfield.Error(f"source: found {type(source).__name__}, expected {expected}")


def open(path, progress=None, *, threads=None):
    """Opens a source, a page file or a run; or a list of them, to be shown together. A folder is the one of them that lies in it.

    A source of particles is built into the user's cache first, where the program finds it, too, unless it is there already: on so many
    ``threads`` [all], in half of the free memory, where :func:`build` takes another amount. ``progress`` is called with the stage, the steps
    done and their number; True shows a bar.

    >>> box = deepfield.open("box.df")
    >>> box.kind, box.count, box.unit
    ('particles', 200, 'kpc')
    """
    threads = asked.threads(threads)
    # It is the same data wherever Python goes.
    paths = [files.whole_path(one) for one in paths_of(path)]
    with progresses.teller(progress) as tell:
        native, told = _deepfield.open(paths, threads, tell)
    notes.tell(told)
    return Data(native)


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


class Data:
    """Open data.

    ``kind`` is ``particles``, ``run``, ``image``, ``volume``, ``heights`` or ``mixed``; ``families`` are by name; ``bounds`` are the smallest
    and the largest coordinates, (2, 3), in ``unit``; ``modes`` are the visualization modes that draw it, ``attributes`` what can give the hue.
    """

    def __init__(self, native):
        about = json.loads(native.about)
        self._native = native
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
        self._read = [files.whole_path(path) for path in (*self.paths, about.get("source")) if path]
        slices = [path for path in self._read if self.kind == "volume" and os.path.isdir(path)]
        self._read += [entry.path for folder in slices for entry in os.scandir(folder)]
        self.families = {found["name"]: _family(found) for found in about["families"]}
        fields = (name for family in self.families.values() for name in family.fields)
        self.attributes = about.get("attributes") or list(dict.fromkeys(fields))

    def __reduce__(self):
        """Copies, and those that are sent to other processes of this machine, are opened there."""
        return open, (self.paths,)

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
        threads=None,
        config=None,
        scene=None,
        progress=None,
        **settings,
    ):
        """A picture, converged.

        ``camera`` is a Camera or a mapping with ``eye``, ``target``, ``up`` and ``fov`` or ``ortho``; without it all of the data is in view.
        ``size`` is width and height [1200 x 800], ``mode`` a visualization mode, ``attribute`` what gives the hue, ``error_px`` the largest
        displacement of a particle on screen [0.8]; ``exact`` draws every source particle at full precision. ``transfer`` is a
        TransferFunction, the name of a preset or a file, ``background`` "black", "transparent" or "#rrggbb", ``time`` when of a run ("step:12",
        "z:1.5", "last"). ``memory`` is what pages may take, in bytes or as "2GiB", ``threads`` how many draw [all]. ``config`` is a file or a text in RON, as ``deepfield render --config`` reads it, and ``scene`` a Scene, a mapping of its fields or a file: what is said
        beside it holds, then it does. ``progress`` is as of :func:`open`. All other names are settings of the mode, with underscores for
        hyphens; ``deepfield modes`` lists them.

        >>> camera = {"eye": (0.5, 0.5, 9.0), "target": (0.5, 0.5, 0.5), "ortho": 2.0}
        >>> picture = data.render(camera, size=(60, 40), mode="column-density")
        >>> mass = picture.channels["P"].sum(dtype=float) * picture.pixel_area
        >>> bool(abs(mass - 200.0) < 2.0)
        True
        """
        wanted = {
            "camera": Camera.of(camera).asked(),
            "size": None if size is None else asked.size(size),
            "mode": mode,
            "attribute": attribute,
            "exact": bool(exact),
            "error_px": error_px,
            "family": family,
            "transfer": _transfer(transfer),
            "background": background,
            "time": None if time is None else str(time),
            "memory": asked.memory(memory),
            "settings": {name.replace("_", "-"): value for name, value in settings.items()},
            **_config(config),
            **self._scene(scene),
        }
        with progresses.teller(progress) as tell:
            native, told = self._native.render(asked.text(wanted), asked.threads(threads), tell)
        notes.tell(told)
        return Picture(native, told, self._read)

    def _scene(self, scene):
        """A scene by its text, with the file beside which lies what it names."""
        if scene is None:
            return {}
        if isinstance(scene, (str, os.PathLike)):
            scene = Scene.read(scene)
        elif not isinstance(scene, Scene):
            scene = Scene(self, **scene)
        return {"scene": scene.to_ron(), "scene_file": scene.path}

    def widget(self, mode=None, attribute=None, size=(720, 480), camera=None, time=None, *, error_px=0.8, budget=0.1, **asked):
        """A view in a notebook that is turned, dragged, zoomed and asked; anywidget has to be installed.

        Arguments are those of :meth:`render`. While the view moves pictures are as coarse as it takes to draw one in about ``budget``
        seconds; at rest one of ``size`` and ``error_px`` is drawn. Its ``camera`` is the camera as it stands, its ``picture`` what is shown.
        """
        from .widget import widget

        return widget(
            self, mode=mode, attribute=attribute, size=size, camera=camera, time=time, error_px=error_px, budget=budget, **asked
        )

    def view(self, **fields):
        """Opens it in the program's window, where there is a display, and gives the process at once: ``data.view(mode="points")``.

        ``fields`` are those of a :class:`Scene`. The program is the one that the variable DEEPFIELD_PROGRAM names, else the one that
        the wheel brought, else the first ``deepfield`` on the path.
        """
        from .window import open_window

        return open_window(Scene(self, **fields))

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
        threads=None,
        progress=None,
    ):
        """Sums over all particles in a region, as ``deepfield probe --json`` tells them.

        ``sphere`` is (x, y, z, radius), ``box`` (x0, y0, z0, x1, y1, z1), ``where`` a mapping of fields to (least, largest), either of which
        may be None; ``families`` names some. With several a particle has to be within all of them. ``shells`` are those of a radial profile
        in the sphere. Of a page file the answer says how far off it may be; ``exact`` asks the source that it was built from. ``threads`` is how
        many answer [all]. ``table`` of the answer is a Table with a row for each family.

        >>> data.probe(box=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0), threads=1)["count"]
        200
        """
        wanted = {
            "of": questions.of(sphere, box, where, families, exact, wrap, time),
            "fields": asked.listed(fields),
            "shells": asked.whole("shells", shells, 4096),
            "shell_field": shell_field,
        }
        return questions.Probe(self._asked(self._native.probe, wanted, threads, progress))

    def _asked(self, question, wanted, threads, progress):
        with progresses.teller(progress) as tell:
            found, told = question(asked.text(wanted), asked.threads(threads), tell)
        notes.tell(told, 4)
        return json.loads(found)

    def _rows(self, question, wanted, ids, memory, threads, progress):
        wanted["memory"] = asked.memory(memory)
        with progresses.teller(progress) as tell:
            columns, about, told = question(asked.text(wanted), questions.ids_of(ids), asked.threads(threads), tell)
        notes.tell(told, 4)
        return questions.table(columns, json.loads(about))

    def select(
        self,
        sphere=None,
        box=None,
        ids=None,
        where=None,
        families=None,
        fields=None,
        *,
        exact=False,
        wrap=True,
        time=None,
        memory=None,
        threads=None,
        progress=None,
    ):
        """The particles of a region, or those with certain ids, as a Table: a row each.

        The region is that of :meth:`probe`; ``ids`` is an array of whole numbers, in place of it. ``fields`` names the columns, ``position``,
        ``velocity`` and such being their components, and ``id``; all of them without it. Rows are read from the source at its own precision, also
        of a page file whose source is still there; else from the page file, which has no ids (``exact=True`` refuses that). ``memory`` is what they
        may take, in bytes or as "2GiB" [half of what is free], ``threads`` how many read [all].

        >>> warm = data.select(where={"temperature": (0.5, None)}, fields=["x", "temperature"])
        >>> warm.columns, warm.units["x"], bool(warm["temperature"].min() > 0.49)
        (['family', 'x', 'temperature'], 'kpc', True)
        """
        of = questions.of(sphere, box, where, families, exact, wrap, time)
        wanted = {"of": of, "fields": asked.listed(fields)}
        return self._rows(self._native.select, wanted, ids, memory, threads, progress)

    def tracks(
        self,
        sphere=None,
        box=None,
        ids=None,
        where=None,
        families=None,
        fields=None,
        *,
        start=None,
        end=None,
        memory=None,
        threads=None,
        progress=None,
    ):
        """The tracks of a run's particles as a Table: for each particle and interval a row at each end, as ``deepfield paths`` writes them.

        ``ids`` names the particles; a region leaves the ends of tracks that lie in it. ``start`` and ``end`` are times [all of the run].
        """
        wanted = {
            "of": questions.of(sphere, box, where, families),
            "fields": asked.listed(fields),
            "from": None if start is None else str(start),
            "to": None if end is None else str(end),
        }
        return self._rows(self._native.tracks, wanted, ids, memory, threads, progress)

    def histogram(
        self,
        field,
        bins=100,
        weight="mass",
        range=None,
        log=None,
        *,
        sphere=None,
        box=None,
        where=None,
        families=None,
        exact=False,
        wrap=True,
        time=None,
        error=None,
        threads=None,
        progress=None,
    ):
        """A Histogram of a field, as ``deepfield plot --histogram`` finds it.

        ``weight`` is what particles count for: "mass", "count" or their value of a field. ``range`` is from where to where [all values], ``log``
        whether bins are equal in the logarithm [as values ask for]. Of a page file ``error`` is the relative error that is enough, such as
        0.01: a part of it is read then, and ``about`` tells the error. The region is that of :meth:`probe`.

        >>> found = data.histogram("temperature", bins=4, weight="count", range=(0.0, 1.0), log=False)
        >>> len(found.edges), int(found.counts.sum())
        (5, 200)
        """
        wanted = {
            "of": questions.of(sphere, box, where, families, exact, wrap, time),
            "axes": [_axis(field, bins, range, log)],
            "weight": weight,
            "error": error,
        }
        return questions.histogram(self._asked(self._native.plot, wanted, threads, progress))

    def phase(
        self,
        x,
        y,
        bins=(256, 256),
        weight="mass",
        ranges=(None, None),
        log=None,
        *,
        sphere=None,
        box=None,
        where=None,
        families=None,
        exact=False,
        wrap=True,
        time=None,
        error=None,
        threads=None,
        progress=None,
    ):
        """A PhaseDiagram of two fields, as ``deepfield plot --phase`` finds it; arguments are those of :meth:`histogram`, a pair of each.

        >>> found = data.phase("temperature", "mass", (8, 4), "count", ((0.0, 1.0), (0.0, 2.0)), log=False)
        >>> found.counts.shape, int(found.counts.sum()), found.fields
        ((4, 8), 200, ('temperature', 'mass'))
        """
        axes = [_axis(*axis) for axis in zip((x, y), _pair("bins", bins), _pair("ranges", ranges), _pair("log", log))]
        wanted = {
            "of": questions.of(sphere, box, where, families, exact, wrap, time),
            "axes": axes,
            "weight": weight,
            "error": error,
        }
        return questions.phase_diagram(self._asked(self._native.plot, wanted, threads, progress))

    def profile(
        self,
        sphere,
        shells=50,
        fields=(),
        log=True,
        *,
        box=None,
        where=None,
        families=None,
        exact=False,
        wrap=True,
        time=None,
        error=None,
        threads=None,
        progress=None,
    ):
        """A radial profile in a sphere (x, y, z, radius) as a Table with a row for each shell, as ``deepfield plot --radial`` finds it.

        There are the shells' radii, counts, masses and densities, and of each of ``fields`` mean and dispersion, plain and weighted with mass.
        ``log`` makes shells equal in the logarithm over two decades, else they are of equal width. ``error`` is that of :meth:`histogram`.
        ``about["fields"]`` tells by name how far off the values of each field may be.

        >>> shells = data.profile((0.5, 0.5, 0.5, 0.4), shells=4, fields="temperature")
        >>> len(shells), shells.units["radius_to"], "mean_temperature" in shells
        (4, 'kpc', True)
        """
        fields = asked.listed(fields) or [None]
        wanted = {
            "of": questions.of(sphere, box, where, families, exact, wrap, time),
            "profiles": [{"shells": _whole("shells", shells), "inner": 0.01 if log else None, "field": field} for field in fields],
            "error": error,
        }
        return questions.profile(self._asked(self._native.plot, wanted, threads, progress))

    def array(self, level=0, stored=False, *, memory=None, progress=None):
        """The samples of an image or a volume: shape (y, x) or (z, y, x), and of several channels one axis more, the last.

        ``level`` leaves every 2^level-th sample along each axis. Values are as they are stored, in the type of the file, unless that scales
        them or marks missing ones: then they are float64 with NaN, or as stored with ``stored=True``. ``memory`` is what they may take.

        >>> np.save("cube.npy", np.arange(210, dtype=np.int16).reshape(6, 5, 7))
        >>> volume = deepfield.open("cube.npy")
        >>> volume.shape, volume.array().shape, volume.array(level=1).shape
        ((7, 5, 6), (6, 5, 7), (3, 3, 4))
        """
        wanted = {"level": _whole("level", level), "stored": bool(stored), "memory": asked.memory(memory)}
        with progresses.teller(progress) as tell:
            content, about = self._native.samples(asked.text(wanted), tell)
        about = json.loads(about)
        samples = content.view(about["dtype"]).reshape(about["shape"])
        channels = about["channels"]
        plain = all((one["slope"], one["intercept"], one["no_data"]) == (1.0, 0.0, None) for one in channels)
        if stored or plain:
            return samples
        values = samples.astype(np.float64)
        each = values[..., np.newaxis] if len(channels) == 1 else values
        for index, one in enumerate(channels):
            channel = each[..., index]
            missing = None if one["no_data"] is None else channel == one["no_data"]
            channel *= one["slope"]
            channel += one["intercept"]
            if missing is not None:
                channel[missing] = np.nan
        return values

    def heights(self, rows=None, columns=None, coordinates=False, *, memory=None, progress=None):
        """Measured heights: float64 (rows, columns), NaN where nothing was measured.

        ``rows`` and ``columns`` are slices or pairs of the first one and the one after the last. With ``coordinates`` come x of the columns and
        y of the rows, too: (heights, x, y).

        >>> np.save("slope.npy", np.add.outer(np.arange(6.0), np.arange(9.0)))
        >>> deepfield.open("slope.npy").heights(rows=(4, 6), columns=slice(0, 3))
        array([[4., 5., 6.],
               [5., 6., 7.]])
        """
        if self.kind in ("particles", "run", "volume"):
            raise _deepfield.Error(f"{self.paths[0]}: heights: found {self.kind}, expected measured heights")
        width, height = self.shape if self.kind == "heights" else (0, 0)
        wanted = {
            "rows": _part("rows", rows, height),
            "columns": _part("columns", columns, width),
            "memory": asked.memory(memory),
        }
        with progresses.teller(progress) as tell:
            found, about = self._native.heights(asked.text(wanted), tell)
        if not coordinates:
            return found
        about = json.loads(about)
        x, y = (
            origin + step * np.arange(count)
            for origin, step, count in zip(about["origin"], about["step"], found.shape[::-1])
        )
        return found, x, y


def _axis(field, bins, range, log):
    ends = None if range is None else questions.numbers("range", range, "least, largest")
    return {"field": field, "bins": _whole("bins", bins), "range": ends, "logarithmic": log}


def _pair(name, value):
    """What is asked of two axes, of each or of both."""
    if not isinstance(value, (tuple, list, np.ndarray)):
        return value, value
    if len(value) != 2:
        raise _deepfield.Error(f"{name}: found {value!r}, expected one of x and one of y")
    return tuple(value)


def _whole(name, value):
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    if not is_number or not 0 <= value < np.inf or int(value) != value:
        raise _deepfield.Error(f"{name}: found {value!r}, expected a whole number from 0 on")
    return int(value)


def _part(name, part, count):
    if part is None:
        return None
    if isinstance(part, slice):
        start, stop, step = part.indices(count)
        part = (start, stop) if step == 1 else ()
    if not isinstance(part, (tuple, list, np.ndarray)) or len(part) != 2:
        raise _deepfield.Error(f"{name}: found {part!r}, expected a slice without a step, or the first one and the one after the last")
    return [_whole(name, end) for end in part]


def _transfer(transfer):
    if transfer is None or isinstance(transfer, str):
        return transfer
    # The text of a file may begin with a comment, by which it would not be told from a name.
    return TransferFunction(**transfer.fields).to_ron() if isinstance(transfer, TransferFunction) else os.fspath(transfer)


def _spaced(count):
    return f"{count:,}".replace(",", " ")


def _config(config):
    """A configuration by its text, with what messages call it."""
    if config is None:
        return {}
    if isinstance(config, str) and config.lstrip().startswith("("):
        return {"config": config, "config_name": "config"}
    if not isinstance(config, (str, os.PathLike)):
        raise _deepfield.Error(f"config: found {type(config).__name__}, expected a file or a text in RON")
    return {"config": files.read(config), "config_name": os.fspath(config)}
