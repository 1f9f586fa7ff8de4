"""Finished pictures: colours, numbers, and what they mean."""

import functools
import json

import numpy as np

from . import _deepfield, files


class Picture:
    """A picture.

    ``rgba`` are its colours, uint8 (height, width, 4), gamma-encoded, row 0 at the top; ``channels`` its numbers by name: ``P`` and, where an
    attribute gives the hue, ``S`` (NaN where nothing was drawn, else between the ends of its values) of modes that add up, linear
    premultiplied ``R``, ``G``, ``B``, ``A`` of the others, and of heights also ``depth``, ``x``, ``y``, ``height``, ``row``, ``column`` and
    ``coverage``. ``units`` are those of P and S.
    The arrays are the memory that it was drawn into, so that files have what is written into ``rgba``.

    ``extent`` is (left, right, lower, upper) of a picture with parallel lines of sight, from its middle along its own right and up, in
    ``unit``: what matplotlib's ``imshow`` takes. It is None of a perspective picture, whose pixels have no size of their own.

    >>> picture = data.render(size=(60, 40), mode="column-density")
    >>> picture.rgba.shape, picture.png()[1:4]
    ((40, 60, 4), b'PNG')
    """

    def __init__(self, native, notes=(), sources=()):
        about = json.loads(native.about)
        self._native = native
        # Files that it is of, which it is not written over.
        self._sources = list(sources)
        self.notes = list(notes)
        self.about = about
        self.mode = about["mode"]
        self.attribute = about["attribute"]
        self.unit = about["unit"] or ""
        self.units = {name: unit for name, unit in about["units"].items() if unit is not None}
        self.extent = None if about["extent"] is None else tuple(about["extent"])
        self.view = {name: np.array(vector) for name, vector in about["view"].items()}
        self.converged = about["converged"]

    def __reduce__(self):
        # Arrays that were handed out are views of the native part's, in copies too.
        return Picture, (self._native, self.notes, self._sources)

    @functools.cached_property
    def rgba(self):
        """Colours, uint8 (height, width, 4)."""
        return self._native.rgba()

    @functools.cached_property
    def channels(self):
        """Numbers by name, (height, width) each."""
        return self._native.channels()

    @property
    def size(self):
        """Width and height, pixels."""
        height, width = self.rgba.shape[:2]
        return width, height

    @property
    def pixel_area(self):
        """The area of a pixel of a picture with parallel lines of sight, square of ``unit``."""
        if self.extent is None:
            return None
        left, right, lower, upper = self.extent
        width, height = self.size
        return (right - left) / width * (upper - lower) / height

    def png(self):
        """The bytes of its PNG, those of the program's file."""
        return self._native.png()

    def save(self, path):
        """Writes a file: its colours as .png, its channels as .npz; over none that it is a picture of.

        >>> picture = data.render(size=(60, 40), mode="column-density")
        >>> picture.save("box.png")
        >>> picture.save("box.npz")
        >>> with np.load("box.npz") as channels:
        ...     channels["P"].shape
        (40, 60)
        """
        path = files.expanded(path)
        files.refuse(path, self._sources)
        if path.lower().endswith(".png"):
            self._native.write_png(path)
        elif path.lower().endswith(".npz"):
            with files.written(path) as file:
                np.savez(file, **self.channels)
        else:
            raise _deepfield.Error(f"{path}: expected a name that ends in .png or .npz")

    def imshow(self, ax=None, channel=None, colorbar=True, **settings):
        """Shows it in axes of matplotlib [the current ones], in its own extent where it has one, with a colour bar; gives what ``imshow`` gives.

        Without ``channel`` its colours are shown, and the bar tells what they mean; else the numbers of that channel. ``settings`` are those of
        ``imshow``, such as ``norm="log"`` and ``cmap`` of a channel.
        """
        from matplotlib import pyplot  # type: ignore

        ax = pyplot.gca() if ax is None else ax
        settings = {"origin": "upper", "extent": self.extent, **settings}
        bar = None
        if channel is None:
            image = ax.imshow(self.rgba, **settings)
            bar = self._bar() if colorbar else None
        else:
            if channel not in self.channels:
                raise _deepfield.Error(f"channel: found {channel}, expected one of {', '.join(self.channels)}")
            image = ax.imshow(self.channels[channel], **settings)
            if colorbar:
                bar = image, self._labelled(channel, self.units.get(channel))
        if bar is not None:
            ax.figure.colorbar(bar[0], ax=ax, label=bar[1])
        if self.extent is None:
            ax.set_axis_off()
        else:
            ax.set_xlabel(self._labelled("x", self.unit))
            ax.set_ylabel(self._labelled("y", self.unit))
        return image

    def show(self, ax=None, **settings):
        """As :meth:`imshow`; without axes in a figure of its own, which is shown at once."""
        from matplotlib import pyplot  # type: ignore

        if ax is not None:
            return self.imshow(ax, **settings)
        image = self.imshow(pyplot.figure().add_subplot(), **settings)
        pyplot.show()
        return image

    @staticmethod
    def _labelled(name, unit):
        return f"{name} [{unit}]" if unit else name

    def _bar(self):
        """What a bar of its colours is made from, and its label: of the hue, where there is one. None where colours mean nothing by themselves."""
        from matplotlib import cm, colors  # type: ignore

        legend = self.about.get("legend")
        axis = legend and (legend["hue"] or legend["brightness"])
        if not axis:
            return None
        low, high = axis["range"]
        if not low < high:
            return None
        norm = colors.LogNorm(low, high) if axis["logarithmic"] and low > 0.0 else colors.Normalize(low, high)
        shades = colors.ListedColormap(np.array(axis["colors"]) / 255.0)
        return cm.ScalarMappable(norm, shades), self._labelled(axis["title"], axis["unit"])

    def _repr_png_(self):
        return self.png()

    def __array__(self, dtype=None, copy=None):
        array = self.rgba if dtype is None else self.rgba.astype(dtype)
        return array.copy() if copy and array is self.rgba else array

    def __repr__(self):
        width, height = self.size
        units = "".join(f", {name} in {unit}" for name, unit in self.units.items() if unit)
        hue = f" of {self.attribute}" if self.attribute else ""
        return f"<picture {width} x {height}: {self.mode}{hue}{units}>"
