"""Builds page files, from files and from arrays."""

from collections.abc import Mapping

from . import _deepfield, asked, columns, files, notes, opening, others, progress as progresses


def kept(attributes, families, derive, hierarchy, smoothing):
    """What is kept of particles and built over them, as the native part reads it."""
    return {
        "attributes": asked.listed("attributes", attributes), "families": asked.listed("families", families),
        "derive": asked.names("derive", derive), "hierarchy": asked.names("hierarchy", hierarchy), "smoothing": smoothing,
    }  # fmt: skip


def _raw(shape, type, spacing, big_endian, channels, skip):
    """What a file without a header holds; None where nothing is said of its shape."""
    if shape is None:
        for name, is_said in (("type", type is not None), ("big_endian", big_endian), ("channels", channels != 1), ("skip", skip != 0)):
            if is_said:
                raise _deepfield.Error(f"{name}: found no shape, expected one beside it")
        return None
    if type is None:
        raise _deepfield.Error("type: missing, expected the type of the samples beside shape")
    asked.whole("channels", channels, 4096)
    asked.whole("skip", skip, 2**63 - 1, 0)
    sides = {"shape": shape, "type": str(type), "big_endian": bool(big_endian), "channels": channels, "skip": skip}
    return sides if spacing is None else {**sides, "spacing": spacing}


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
    kind=None,
    nodata=None,
    spacing=None,
    xy_unit=None,
    height_unit=None,
    texture=None,
    texture_at=None,
    shape=None,
    type=None,
    big_endian=False,
    channels=1,
    skip=0,
    times=None,
    every=None,
    skip_damaged=False,
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
    Of more than five attributes, derived ones among them, those that ``attributes`` names are kept, and without it the most telling ones by their
    names, then the first of the others; what is left out is told.

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
    the source's own]. ``kind``, ``nodata``, ``spacing``, ``xy_unit``, ``height_unit``, ``texture`` and ``texture_at`` are those of :func:`open`.

    A file that is samples and nothing else is told by their ``shape``, (width, height) or (width, height, depth), the fastest axis first, and their
    ``type``, such as "u16" or "float32": ``spacing`` is how far they are apart, ``channels`` how many values each has, ``skip`` how many bytes are
    before the first, and ``big_endian`` whether the most significant byte comes first.

    >>> np.arange(24, dtype=np.uint16).tofile("samples.raw")
    >>> deepfield.build("samples.raw", "samples.df", shape=(4, 3, 2), type="u16", spacing=(1, 1, 2)).array()[1, 0].tolist()
    [12, 13, 14, 15]

    Of the snapshots of a run ``times`` are the steps' times in place of their own: a list, or a text such as "0:0.5" (the first one and how far
    they are apart) or "steps" (their numbers); ``every`` keeps every so many-th step, and ``skip_damaged`` leaves steps out whose files are damaged.

    >>> deepfield.build("movie.xyz", "half.df", every=2, times="steps").steps.tolist()
    [0.0, 2.0]

    ``memory`` is what the build may take beside arrays, in bytes or as "2GiB" [half of what is free], ``threads`` how many build [all];
    ``progress`` is called with the stage, the steps done and their number, some times a second, or True for a bar. What it raises, and Ctrl-C, end the build, and nothing is left behind.
    """
    out = files.expanded(out)
    attributes, families = asked.listed("attributes", attributes), asked.listed("families", families)
    wanted = kept(attributes, families, derive, hierarchy, smoothing)
    wanted |= {"memory": asked.memory(memory), "height_error": asked.number("height_error", height_error), "threads": asked.threads(threads)}
    of_files = {
        "heights": opening.stated(
            kind=kind, nodata=nodata, spacing=spacing if shape is None else None, xy_unit=xy_unit, height_unit=height_unit,
            texture=texture, texture_at=texture_at,
        ),
        "raw": _raw(shape, type, spacing, big_endian, channels, skip),
        "times": asked.names("times", times), "every": asked.whole("every", every, 2**31), "skip_damaged": bool(skip_damaged),
    }  # fmt: skip
    read = others.files_of(source)
    if others.package_of(source):
        source, own, said = others.arrays_of(source, attributes, families)
        units = {**own, **(units or {})}
        box_size, redshift = (said.get(name) if given is None else given for name, given in (("box_size", box_size), ("redshift", redshift)))
    told = []
    source = columns.of_structured(family, source, told)
    if isinstance(source, Mapping):
        wanted["said"] = {
            "box_size": asked.number("box_size", box_size, 0), "time": asked.number("time", time), "redshift": asked.number("redshift", redshift),
        }  # fmt: skip
        source = {name: columns.of_structured(name, fields, told) for name, fields in source.items()}
        nested = bool(source) and all(isinstance(fields, Mapping) for fields in source.values())
        if height_error is not None:
            raise _deepfield.Error("height_error: found arrays, expected a file of heights")
        heights = of_files.pop("heights")
        given = [name for name, value in {**of_files, **heights}.items() if value is not None and value is not False]
        if given:
            raise _deepfield.Error(f"{'shape' if given[0] == 'raw' else given[0]}: found arrays, expected files")
        every = source if nested else {family: source}
        found = columns.columns(every, units or {})
        files.refuse(out, [*read, *columns.files_of(every)])
        with progresses.teller(progress) as tell:
            told += columns.left_out(found) + _deepfield.build_arrays(found, out, asked.text(wanted), tell)
    else:
        said = {"units": units, "box_size": box_size, "time": time, "redshift": redshift}
        given = [name for name, value in said.items() if value is not None]
        if given:
            raise _deepfield.Error(f"{given[0]}: found files, expected arrays: files say that of themselves")
        with progresses.teller(progress) as tell:
            paths = opening.paths_of(source, "a path, a list of paths, or a mapping of names to arrays")
            told = _deepfield.build_files(paths, out, asked.text({**wanted, **of_files}), tell)
    notes.tell(told)
    return opening.open(out)
