"""Builds page files, from files and from arrays."""

import os
from collections.abc import Mapping

from . import _deepfield, asked, columns, dataset, files, notes, others, progress as progresses


def kept(attributes, families, derive, hierarchy, smoothing):
    """What is kept of particles and built over them, as the native part reads it."""
    return {
        "attributes": asked.listed(attributes), "families": asked.listed(families), "derive": asked.names(derive),
        "hierarchy": asked.names(hierarchy), "smoothing": smoothing,
    }  # fmt: skip


def build(
    source,
    out,
    memory=None,
    progress=None,
    *,
    attributes=None,
    families=None,
    derive=None,
    hierarchy=None,
    smoothing=None,
    height_error=None,
    threads=None,
    units=None,
    family="gas",
    box_size=None,
    time=None,
    redshift=None,
):
    """Builds the page file ``out`` and opens it.

    ``source`` is a path, a list of paths (snapshots of a run), or arrays: a mapping of names to arrays or a structured array, of one family
    named ``family``, or a mapping of families to such. ``positions`` (n, 3) has to be there; ``mass``, ``smoothing_length``, ``density`` (n) and
    ``velocities`` (n, 3) mean what they say, and everything else of shape (n) or (n, 3) is an attribute. A smoothing length is the radius at
    which a particle ends. What is missing is estimated, as of a file: masses are 1, smoothing lengths the distance to the 32nd neighbour.

    A snapshot of pynbody, a data set or a container of yt and a data set of swiftsimio are read as they are in memory: the families that
    they have, ``attributes`` by their own names [temperature, internal energy, metallicity and speed], units, box and redshift.

    Units come from ``units``, a mapping of names to texts, else from what arrays say of themselves (``.units``, ``.unit``). Nothing is
    converted. ``box_size`` is the edge of a periodic box.

    ``derive`` names attributes that follow from velocities, such as "velocity-dispersion,vorticity" or a list of them, or "all";
    ``hierarchy`` what is built over the leaves, such as "octree,pca" ["octree"]; ``smoothing`` where smoothing lengths come from:
    "auto", "field:NAME" or "knn:K", the distance to the K-th neighbour. All are those of ``deepfield build``.

    >>> chance = np.random.default_rng(2)
    >>> gas = {"positions": chance.random((500, 3)), "velocities": chance.random((500, 3))}
    >>> box = deepfield.build(gas, "moving.df", derive="divergence", smoothing="knn:16")
    >>> sorted(name for name in box.families["gas"].fields if name in ("divergence", "speed"))
    ['divergence', 'speed']

    ``height_error`` is how far heights of a file may be from the source's, in their unit: a larger one makes a smaller file [None: they are
    the source's own].

    ``memory`` is what the build may take beside arrays, in bytes or as "2GiB" [half of what is free], ``threads`` how many build [all];
    ``progress`` is called with the stage, the steps done and their number, some times a second, or True for a bar. What it raises, and Ctrl-C, end the build, and nothing is left behind.
    """
    out = os.fspath(out)
    attributes, families = asked.listed(attributes), asked.listed(families)
    wanted = kept(attributes, families, derive, hierarchy, smoothing)
    wanted |= {"memory": asked.memory(memory), "height_error": asked.number("height_error", height_error), "threads": asked.threads(threads)}
    read = others.files_of(source)
    if others.package_of(source):
        source, own, said = others.arrays_of(source, attributes, families)
        units = {**own, **(units or {})}
        box_size, redshift = (said.get(name) if given is None else given for name, given in (("box_size", box_size), ("redshift", redshift)))
    source = columns.of_structured(source)
    if isinstance(source, Mapping):
        wanted["said"] = {
            "box_size": asked.number("box_size", box_size, 0), "time": asked.number("time", time), "redshift": asked.number("redshift", redshift),
        }  # fmt: skip
        source = {name: columns.of_structured(fields) for name, fields in source.items()}
        nested = bool(source) and all(isinstance(fields, Mapping) for fields in source.values())
        if height_error is not None:
            raise _deepfield.Error("height_error: found arrays, expected a file of heights")
        every = source if nested else {family: source}
        found = columns.columns(every, units or {})
        files.refuse(out, [*read, *columns.files_of(every)])
        with progresses.teller(progress) as tell:
            told = columns.left_out(found) + _deepfield.build_arrays(found, out, asked.text(wanted), tell)
    else:
        said = {"units": units, "box_size": box_size, "time": time, "redshift": redshift}
        given = [name for name, value in said.items() if value is not None]
        if given:
            raise _deepfield.Error(f"{given[0]}: found files, expected arrays: files say that of themselves")
        with progresses.teller(progress) as tell:
            paths = dataset.paths_of(source, "a path, a list of paths, or a mapping of names to arrays")
            told = _deepfield.build_files(paths, out, asked.text(wanted), tell)
    notes.tell(told)
    return dataset.open(out)
