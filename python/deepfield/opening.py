"""Opens what a path, several or a scene name."""

import contextlib
import os
from collections.abc import Mapping

from . import _deepfield, asked, dataset, files
from .objects import Scene


def paths_of(source, expected="a path or a list of paths"):
    """Paths of one or of several."""
    if isinstance(source, (str, os.PathLike)):
        return [files.expanded(source)]
    with contextlib.suppress(TypeError):
        # Rows and columns are no paths, though the latter may have names.
        if getattr(source, "ndim", 1) == 1:
            return [files.expanded(one) for one in source]
    raise _deepfield.Error(f"source: found {type(source).__name__}, expected {expected}")


def _datasets_of(source):
    """Paths of one dataset or of several, and what is said of each."""
    if isinstance(source, Mapping):
        source = [source]
    if not isinstance(source, (list, tuple)):
        paths = paths_of(source)
        return paths, [{} for _ in paths]
    said = [dict(one) if isinstance(one, Mapping) else {"path": one} for one in source]
    paths = paths_of([one.pop("path", None) for one in said], "paths, or mappings with a path")
    return paths, [stated(**one) for one in said]


def stated(**said):
    """What is said of data, without what is not; files are named from the root on."""
    for name in ("before", "texture"):
        if said.get(name) is not None:
            said[name] = files.whole_path(files.expanded(said[name]))
    return {name: value for name, value in said.items() if value is not None}


def open(
    path,
    progress=None,
    *,
    kind=None,
    nodata=None,
    spacing=None,
    xy_unit=None,
    height_unit=None,
    texture=None,
    texture_at=None,
    before=None,
    derive=None,
    threads=None,
    memory=None,
):
    """Opens a source, a page file or a run; or a list of them, to be shown together; or the data of a scene file, which :meth:`Data.render` then
    draws as the scene says. A folder is the one of them that lies in it.

    ``kind`` is what a file is taken for: "heights", "image" (also a volume), or "particles" [as its content tells]. Of heights ``nodata`` is the
    stored value of samples that were not measured, ``spacing`` the distances of columns and of rows, ``xy_unit`` and ``height_unit`` are units
    [as the file says], ``texture`` is a photo that lies over them, ``texture_at`` two opposite corners of it, (x0, y0, x1, y1) [those of the
    heights], and ``before`` earlier heights that they are compared with. ``derive`` names attributes of particles that follow from velocities, as of
    :func:`build`. In a list a mapping says such things of one dataset, and where it lies among the others, as scenes do:
    ``{"path": "b.df", "offset": (10, 0, 0), "scale": 2.0, "families": ["gas"]}``.

    A source of particles is built into the user's cache first, where the program finds it, too, unless it is there already: on so many
    ``threads`` [all], in so much ``memory``, in bytes or as "2GiB" [half of what is free]. How much the cache holds is said by the variable
    DEEPFIELD_CACHE; what pages of open data take is said to :meth:`Data.render`. ``progress`` is called with the stage, the steps done and their
    number; True shows a bar.

    >>> box = deepfield.open("box.df", memory="1GiB")
    >>> box.kind, box.count, box.unit
    ('particles', 200, 'kpc')
    >>> two = deepfield.open(["box.df", {"path": "box.df", "offset": (2, 0, 0)}])
    >>> two.count, (two.bounds[1] - two.bounds[0] > (2, 0, 0)).tolist()
    (400, [True, True, True])
    >>> np.save("slope.npy", np.add.outer(np.arange(6.0), np.arange(9.0)))
    >>> np.ptp(deepfield.open("slope.npy", kind="heights", spacing=(2, 2), xy_unit="m").bounds, axis=0).tolist()
    [16.0, 10.0, 13.0]
    """
    threads, memory = asked.threads(threads), asked.memory(memory)
    said = stated(
        kind=kind, nodata=nodata, spacing=spacing, xy_unit=xy_unit, height_unit=height_unit, texture=texture, texture_at=texture_at,
        before=before, derive=asked.names("derive", derive),
    )  # fmt: skip
    if isinstance(path, (str, os.PathLike)) and os.fspath(path).lower().endswith(".ron"):
        return opened(Scene.read(path), said, progress, threads, memory)
    paths, datasets = _datasets_of(path)
    # It is the same data wherever Python goes.
    wanted = {"datasets": datasets, "said": said}
    return dataset.read([files.whole_path(one) for one in paths], wanted, None, progress, threads, memory)


def opened(scene, said=None, progress=None, threads=None, memory=None):
    """The data of a scene, of which more may be said."""
    wanted = {"scene": scene.to_ron(), "scene_file": scene.path, "said": said or {}}
    return dataset.read([], wanted, scene, progress, threads, memory, stacklevel=5)
