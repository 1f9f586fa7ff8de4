"""Transfer functions, scenes and tours, which are files of the program, too."""

import functools
import json
import os

from . import _deepfield, asked, files, notes, progress as progresses


# Fields that name files.
_PATHS = ("path", "before", "dataset", "labels", "texture")


def _placed(value, folder, field=None):
    """The same with names of files that are from a folder from the root on."""
    if isinstance(value, dict):
        return {name: _placed(one, folder, name) for name, one in value.items()}
    if isinstance(value, list):
        return [_placed(one, folder, field) for one in value]
    # An object of a catalogue is named behind its file.
    is_file = isinstance(value, str) and (field in _PATHS or field == "object" and "#" in value)
    return files.whole_path(value, folder) if is_file else value


class _Text:
    """What RON says; fields are attributes, and None of those that are not said."""

    _kind = ""

    def __init__(self, **fields):
        self._ron = _deepfield.ron_of(self._kind, asked.text(self._said(fields)))
        self.path = None

    @staticmethod
    def _said(fields):
        return fields

    @classmethod
    def from_ron(cls, text, name=None):
        """Of a text in RON; ``name`` is what messages call it."""
        _deepfield.json_of(cls._kind, text, name or cls._kind)
        made = cls.__new__(cls)
        made._ron, made.path = text, None
        return made

    def to_ron(self):
        """Its text in RON."""
        return self._ron

    @classmethod
    def read(cls, path):
        """Reads a file."""
        path = files.expanded(path)
        made = cls.from_ron(files.read(path), path)
        made.path = files.whole_path(path)
        return made

    def write(self, path):
        """Writes a file, over none but one in RON. What it names by paths from the folder that it was read from is found from others, too."""
        path = files.expanded(path)
        moved = self.path is not None and files.folder_of(path) != files.folder_of(self.path)
        files.write(path, self._found_from_anywhere().to_ron() if moved else self._ron)

    @functools.cached_property
    def fields(self):
        """What it says, by name; variants of RON such as ``fixed(1.0, 2.0)`` are ``{"fixed": [1.0, 2.0]}``."""
        return json.loads(_deepfield.json_of(self._kind, self._ron, self._kind))

    def asked(self):
        """What it says."""
        return self.fields

    def replace(self, **changes):
        """The same with other values of some fields."""
        return type(self)(**{**self._found_from_anywhere().fields, **changes})

    def _found_from_anywhere(self):
        """The same with files that are named from the folder of its own named from the root on; itself where there are none."""
        if self.path is None:
            return self
        placed = _placed(self.fields, files.folder_of(self.path))
        return self if placed == self.fields else type(self)(**placed)

    def __getattr__(self, name):
        if name.startswith("_") or name not in self.fields:
            raise AttributeError(f"{type(self).__name__} has no field {name}")
        return self.fields[name]

    def __eq__(self, other):
        return type(self) is type(other) and self.fields == other.fields

    __hash__ = None  # type: ignore

    def __repr__(self):
        said = ", ".join(f"{name}={value!r}" for name, value in self.fields.items() if value not in (None, [], {}, ""))
        return f"{type(self).__name__}({said if len(said) < 200 else said[:197] + '...'})"


class TransferFunction(_Text):
    """From values to colours: ``TransferFunction(color_map="viridis", range=(1e-3, 10.0), gamma=1.2)``.

    Its fields are those of the files in assets/transfer. A ``range`` is "auto" or two numbers, a ``color_map`` a name of :func:`color_maps` or a
    list of stops ``[(0.0, "#000000"), (1.0, "#ffffff")]``.

    >>> colors = deepfield.TransferFunction(color_map="viridis", range=(0.25, 8.0))
    >>> colors.range, colors.replace(gamma=2.0).gamma
    ({'fixed': [0.25, 8.0]}, 2.0)
    """

    _kind = "transfer"

    @staticmethod
    def _said(fields):
        def fixed(value):
            pair = isinstance(value, (tuple, list)) and len(value) == 2
            return {"fixed": [float(end) for end in value]} if pair else value

        said = {name: fixed(value) if name == "range" else value for name, value in fields.items()}
        if isinstance(said.get("unit_length"), (int, float)):
            said["unit_length"] = {"fixed": said["unit_length"]}
        if isinstance(said.get("hue"), dict) and "range" in said["hue"]:
            said["hue"] = {**said["hue"], "range": fixed(said["hue"]["range"])}
        return said

    @classmethod
    def named(cls, name):
        """A preset by its name, one of :func:`transfer_functions`."""
        name = files.expanded(name)
        return cls.from_ron(_deepfield.transfer_function(name), name)


class Scene(_Text):
    """What a picture shows: a scene file, as the window saves it with Ctrl+S.

    ``Scene(data, camera=camera, mode="points", settings={"radius": 3.0}, size=(800, 600))`` is of open data or of paths. A time is a number or
    "step:12", "z:1.5", "a:0.4", "last". ``data.render(scene=scene)`` draws it of open data, :meth:`render` of its own.

    >>> scene = deepfield.Scene(data, mode="points", settings={"radius": 3.0}, size=(60, 40))
    >>> data.render(scene=scene).size, scene.replace(mode="column-density", settings={}).mode
    ((60, 40), 'column-density')
    >>> scene.replace(datasets=[{"path": data.paths[0], "offset": (1, 0, 0)}]).open().bounds.round(1).tolist()
    [[1.0, 0.0, 0.0], [2.0, 1.0, 1.0]]
    """

    _kind = "scene"

    def __init__(self, data=None, **fields):
        if data is not None:
            paths = getattr(data, "paths", None) or ([data] if isinstance(data, (str, os.PathLike)) else data)
            said = getattr(data, "_said", None) or [{} for _ in paths]
            fields["datasets"] = [{**one, "path": files.whole_path(files.expanded(path))} for path, one in zip(paths, said)]
        super().__init__(**fields)

    def open(self, progress=None, *, threads=None, memory=None):
        """Opens its data, as it says: arguments are those of :func:`deepfield.open`."""
        from .opening import opened

        return opened(self, None, progress, asked.threads(threads), asked.memory(memory))

    def render(self, camera=None, size=None, **settings):
        """The picture of its own data, which is opened for it; ``settings`` are those of :meth:`deepfield.Data.render`.

        >>> deepfield.Scene("box.df", mode="points", size=(60, 40)).render(radius=2.0).size
        (60, 40)
        """
        return self.open(settings.get("progress")).render(camera, size, **settings)

    @staticmethod
    def _said(fields):
        return {"version": 2, "datasets": [], **fields}


class Tour(_Text):
    """Keyframes in time: a tour file. ``Tour(keyframes=[{...}, ...], size=(1280, 720), rate=30)`` has the fields of docs/tours.md.

    >>> deepfield.Tour.around(seconds=2.0).picture(data, 0.5, size=(24, 16)).size
    (24, 16)
    """

    _kind = "tour"
    _seconds = None

    @staticmethod
    def _said(fields):
        return {"version": 2, "keyframes": [], **fields}

    @classmethod
    def around(cls, seconds=10.0):
        """A tour around whatever data it is of; a run plays along."""
        made = cls.from_ron(_deepfield.tour_around(float(seconds)))
        made._seconds = float(seconds)
        return made

    def _asked(self, **more):
        of = {"seconds": self._seconds} if self._seconds is not None else {"tour": self._ron, "file": self.path}
        return asked.text({**of, **more})

    def render(
        self,
        data,
        out,
        size=None,
        fps=None,
        *,
        start=None,
        end=None,
        pattern=None,
        error_px=None,
        memory=None,
        threads=None,
        progress=None,
    ):
        """Draws its frames as PNG files into the folder ``out``, as ``deepfield tour --record`` does, and gives their paths.

        ``size`` is width and height, ``fps`` frames a second, ``start`` and ``end`` seconds, ``pattern`` the frames' names [frame-%05d].

        >>> frames = deepfield.Tour.around(seconds=2.0).render(data, "frames", size=(24, 16), fps=2, end=1.2)
        >>> len(frames), frames[0][-15:]
        (3, 'frame-00000.png')
        """
        wanted = self._asked(
            size=None if size is None else asked.size(size),
            fps=fps,
            start=start,
            end=end,
            pattern=pattern,
            error_px=error_px,
            memory=asked.memory(memory),
            threads=asked.threads(threads),
        )
        with progresses.teller(progress) as tell:
            paths, told = data._native.record(wanted, files.expanded(out), tell)
        notes.tell(told)
        return [os.fspath(path) for path in paths]

    def scene(self, data, time, size=None, progress=None):
        """The scene that it shows at a time, seconds from its beginning, in a picture of that size [the tour's].

        >>> scene = deepfield.Tour.around(seconds=2.0).scene(data, 0.5, size=(24, 16))
        >>> data.render(scene=scene).size
        (24, 16)
        """
        wanted = self._asked(size=None if size is None else asked.size(size))
        with progresses.teller(progress) as tell:
            text, told = data._native.scene(wanted, float(time), tell)
        notes.tell(told)
        return Scene.from_ron(text)

    def picture(self, data, time, size=None, progress=None, **settings):
        """The picture at a time; ``settings`` are those of ``data.render``."""
        return data.render(scene=self.scene(data, time, size, progress), progress=progress, **settings)
