"""Pictures of open data, its view in a notebook and in a window."""

import os
from collections.abc import Mapping

from . import _deepfield, asked, files, notes, progress as progresses
from .camera import Camera
from .objects import Scene, TransferFunction
from .picture import Picture

# What is written into a picture where that is said in a word.
_ANNOTATIONS = {True: {}, False: {"legend": False, "scale_bar": False, "labels": 0}}


class Drawn:
    """What is drawn of open data."""

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
        families=None,
        transfer=None,
        color_map=None,
        color_scale=None,
        background=None,
        time=None,
        interpolation=None,
        annotations=None,
        cut=None,
        selections=None,
        paths=None,
        projection=None,
        stereo=None,
        catalogue=None,
        exposure=None,
        bloom=None,
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
        displacement of a particle on screen [0.8]; ``exact`` draws every source particle at full precision. ``family`` and ``families`` name what
        is drawn [all], ``transfer`` is a TransferFunction, a mapping of its fields, the name of a preset or a file, ``color_map`` a name of
        :func:`color_maps` in place of its colours (of those of its hue, where it has one), and ``color_scale`` "log" or "linear", ``background`` "black",
        "transparent" or "#rrggbb", ``time`` when of a run ("step:12", "z:1.5", "last"), ``interpolation`` how particles move between its steps.

        ``annotations`` (True: a legend, a scale bar and the names of ``catalogue``, a file), ``cut``, ``selections``, ``paths``, ``projection``,
        ``stereo``, ``exposure`` and ``bloom`` are what the fields of these names say in a configuration, each as a whole, in values of Python:
        mappings, lists and texts, a variant such as ``dome(tilt: 20.0)`` being ``{"dome": {"tilt": 20.0}}`` and ``dome()`` also ``"dome"``.
        All other names are settings of the mode, with underscores for hyphens; ``deepfield modes`` lists them.

        ``memory`` is what pages may take, in bytes or as "2GiB" [half of what is free], ``threads`` how many draw [all]. ``config`` is a file or a
        text in RON, as ``deepfield render --config`` reads it, and ``scene`` a Scene, a mapping of its fields or a file [that which the data was
        opened from]: names hold, then the configuration, then the scene. What a scene says of its datasets is said of this data where it is
        among them; of other data it says which families are drawn, and what is left out is told. ``progress`` is as of :func:`open`.

        >>> camera = {"eye": (0.5, 0.5, 9.0), "target": (0.5, 0.5, 0.5), "ortho": 2.0}
        >>> picture = data.render(camera, size=(60, 40), mode="column-density")
        >>> mass = picture.channels["P"].sum(dtype=float) * picture.pixel_area
        >>> bool(abs(mass - 200.0) < 2.0)
        True
        >>> below = {"clip": {"min": (0, 0, 0), "max": (1, 1, 0.5)}}
        >>> half = data.render(camera, size=(60, 40), mode="column-density", cut=below, annotations={"scale_bar": False, "caption": "z = 0"})
        >>> bool(half.channels["P"].sum() < picture.channels["P"].sum())
        True
        >>> data.render(size=(32, 32), projection="dome", mode="points").size
        (32, 32)
        >>> grey = data.render(camera, size=(60, 40), mode="column-density", color_map="grey", color_scale="linear").rgba
        >>> bool(np.ptp(grey[..., :3].astype(int), axis=-1).max() <= 2)
        True
        """
        fields = {
            "families": asked.listed("families", families),
            "interpolation": interpolation,
            "annotations": _ANNOTATIONS[annotations] if isinstance(annotations, bool) else annotations,
            "cut": cut,
            "selections": selections,
            "paths": paths,
            "projection": projection,
            "stereo": stereo,
            "catalogue": None if catalogue is None else files.expanded(catalogue),
            "exposure": exposure,
            "bloom": bloom,
        }
        wanted = {
            "fields": {name: value for name, value in fields.items() if value is not None},
            "camera": Camera.of(camera).asked(),
            "size": None if size is None else asked.size(size),
            "mode": mode,
            "attribute": attribute,
            "exact": bool(exact),
            "error_px": error_px,
            "family": family,
            "transfer": _transfer(transfer),
            "color_map": color_map,
            "color_scale": color_scale,
            "background": background,
            "time": None if time is None else str(time),
            "memory": asked.memory(memory),
            "settings": {name.replace("_", "-"): value for name, value in settings.items()},
            **_config(config),
            **self._asked_scene(self.scene if scene is None else scene),
        }
        with progresses.teller(progress) as tell:
            native, told = self._native.render(asked.text(wanted), asked.threads(threads), tell)
        notes.tell(told)
        return Picture(native, told, self._read)

    def _asked_scene(self, scene):
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

        return open_window(Scene(self, **fields) if self.scene is None else self.scene.replace(**fields))


def _transfer(transfer):
    if transfer is None:
        return None
    if isinstance(transfer, Mapping):
        transfer = TransferFunction(**transfer)
    # The text of a file may begin with a comment, by which it would not be told from a name.
    return TransferFunction(**transfer.fields).to_ron() if isinstance(transfer, TransferFunction) else files.expanded(transfer)


def _config(config):
    """A configuration by its text, with what messages call it."""
    if config is None:
        return {}
    if isinstance(config, str) and config.lstrip().startswith("("):
        return {"config": config, "config_name": "config"}
    if not isinstance(config, (str, os.PathLike)):
        raise _deepfield.Error(f"config: found {type(config).__name__}, expected a file or a text in RON")
    return {"config": files.read(config), "config_name": files.expanded(config)}
