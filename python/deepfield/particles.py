"""Questions to the particles of open data: sums over them, their rows, files of them and plots."""

import json

import numpy as np

from . import _deepfield, asked, files, notes, progress as progresses, questions


class Particles:
    """What is asked of the particles of open data."""

    def probe(
        self,
        sphere=None,
        box=None,
        where=None,
        families=None,
        *,
        at=None,
        radius=None,
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
        may be None; ``families`` names some. In place of a sphere ``at`` names an object of a catalogue, by its place or its name, such as
        "groups.hdf5#0" (:func:`deepfield.catalogue`); ``radius`` stands in for the object's own. With several a particle has to be within all
        of them. ``shells`` are those of a radial profile in the sphere. Of a page file the answer says how far off it may be; ``exact`` asks the
        source that it was built from. ``threads`` is how many answer [all]. ``table`` of the answer is a Table with a row for each family.

        >>> data.probe(box=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0), threads=1)["count"]
        200
        """
        wanted = {
            "of": questions.of(sphere, box, where, families, exact, wrap, time, at, radius),
            "fields": asked.listed("fields", fields),
            "shells": asked.whole("shells", shells, 4096),
            "shell_field": shell_field,
        }
        return questions.Probe(self._asked(self._native.probe, wanted, threads, progress))

    def select(
        self,
        sphere=None,
        box=None,
        ids=None,
        where=None,
        families=None,
        fields=None,
        *,
        at=None,
        radius=None,
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
        of = questions.of(sphere, box, where, families, exact, wrap, time, at, radius)
        wanted = {"of": of, "fields": asked.listed("fields", fields)}
        return self._rows(self._native.select, wanted, ids, memory, threads, progress)

    def export(
        self,
        path,
        sphere=None,
        box=None,
        ids=None,
        where=None,
        families=None,
        *,
        at=None,
        radius=None,
        frame=None,
        exact=False,
        wrap=True,
        time=None,
        threads=None,
        progress=None,
    ):
        """Writes the particles of a region, or those with certain ids, to a file as ``deepfield select -o`` does; gives how many they are.

        The file is a table with all fields, .csv, .parquet, .ply, .fits, .vtp (VTK) or .hdf5 (a snapshot as Gadget's), or a list of ids, .ids.
        Rows go there as they are read, and may be more than memory holds; the file is there once all are written, and is none that is read.
        The particles are those that :meth:`select` has. With ``frame="physical"`` lengths, densities and velocities of comoving data are physical ones.

        >>> data.export("warm.csv", where={"temperature": (0.5, None)}) == len(data.select(where={"temperature": (0.5, None)}))
        True
        """
        if frame not in (None, "comoving", "physical"):
            raise _deepfield.Error(f"frame: found {frame!r}, expected comoving or physical")
        of = questions.of(sphere, box, where, families, exact, wrap, time, at, radius)
        wanted = asked.text({"of": of, "physical": frame == "physical"})
        with progresses.teller(progress) as tell:
            rows, told = self._native.export(wanted, questions.ids_of(ids), files.expanded(path), asked.threads(threads), tell)
        notes.tell(told)
        return rows

    def tracks(
        self,
        sphere=None,
        box=None,
        ids=None,
        where=None,
        families=None,
        fields=None,
        *,
        at=None,
        radius=None,
        start=None,
        end=None,
        memory=None,
        threads=None,
        progress=None,
    ):
        """The tracks of a run's particles as a Table: for each particle and interval a row at each end, as ``deepfield paths`` writes them.

        ``ids`` names the particles; a region leaves the ends of tracks that lie in it. ``start`` and ``end`` are times [all of the run].

        >>> run = deepfield.build("movie.xyz", "run.df")
        >>> run.steps.tolist()
        [0.0, 1.0, 2.0]
        >>> tracks = run.tracks(ids=[103, 107])
        >>> len(tracks), sorted(set(tracks["id"].tolist()))
        (8, [103, 107])
        """
        wanted = {
            "of": questions.of(sphere, box, where, families, at=at, radius=radius),
            "fields": asked.listed("fields", fields),
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
        at=None,
        radius=None,
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
            "of": questions.of(sphere, box, where, families, exact, wrap, time, at, radius),
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
        at=None,
        radius=None,
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
            "of": questions.of(sphere, box, where, families, exact, wrap, time, at, radius),
            "axes": axes,
            "weight": weight,
            "error": error,
        }
        return questions.phase_diagram(self._asked(self._native.plot, wanted, threads, progress))

    def profile(
        self,
        sphere=None,
        shells=50,
        fields=(),
        log=True,
        *,
        at=None,
        radius=None,
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
        """A radial profile in a sphere (x, y, z, radius), or in that of an object (``at``), as a Table with a row for each shell, as
        ``deepfield plot --radial`` finds it.

        There are the shells' radii, counts, masses and densities, and of each of ``fields`` mean and dispersion, plain and weighted with mass.
        ``log`` makes shells equal in the logarithm over two decades, else they are of equal width. ``error`` is that of :meth:`histogram`.
        ``about["fields"]`` tells by name how far off the values of each field may be.

        >>> shells = data.profile((0.5, 0.5, 0.5, 0.4), shells=4, fields="temperature")
        >>> len(shells), shells.units["radius_to"], "mean_temperature" in shells
        (4, 'kpc', True)
        """
        fields = asked.listed("fields", fields) or [None]
        wanted = {
            "of": questions.of(sphere, box, where, families, exact, wrap, time, at, radius),
            "profiles": [{"shells": asked.count("shells", shells), "inner": 0.01 if log else None, "field": field} for field in fields],
            "error": error,
        }
        return questions.profile(self._asked(self._native.plot, wanted, threads, progress))

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


def _axis(field, bins, range, log):
    ends = None if range is None else questions.numbers("range", range, "least, largest")
    return {"field": field, "bins": asked.count("bins", bins), "range": ends, "logarithmic": log}


def _pair(name, value):
    """What is asked of two axes, of each or of both."""
    if not isinstance(value, (tuple, list, np.ndarray)):
        return value, value
    if len(value) != 2:
        raise _deepfield.Error(f"{name}: found {value!r}, expected one of x and one of y")
    return tuple(value)
