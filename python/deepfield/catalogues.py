"""Catalogues of objects that have names: haloes, clusters, stars."""

import json

import numpy as np

from . import _deepfield, asked, files, notes, progress as progresses
from .table import Table


def catalogue(path, fields=None, *, time=None, memory=None, progress=None):
    """The objects of a catalogue as a Table, the most important first: by mass, then by radius.

    It is what ``deepfield catalogue`` reads: a table with names (CSV), RON, groups of SUBFIND, Gadget-4 and AREPO, haloes of Rockstar, AHF,
    VELOCIraptor and HBT+, and merger trees. Its row N is what ``at="FILE#N"`` names in :meth:`Data.probe` and others.

    There are ``name``, ``x``, ``y``, ``z``, ``radius`` and ``mass``, NaN where the catalogue has none; of names such as "Subhalo 12" also ``kind``
    ("Subhalo") and ``id`` (12); and every other column of numbers under the file's own name, as float64, of vectors a column for each component.
    ``fields`` names some of these, ``position`` being all three, which may take ``memory``, in bytes or as "2GiB" [half of what is free].
    ``time`` is when, of a catalogue of several steps: a number, "step:12", "z:1.5", "a:0.4" or "last". ``about`` has its ``format``,
    ``length_unit``, ``mass_unit``, ``box_size``, and how many were ``left_out`` without a position.

    >>> with open("clusters.csv", "w") as file:
    ...     _ = file.write("name,x [kpc],y [kpc],z [kpc],radius [kpc],mass [Msun],richness\\n")
    ...     _ = file.write("Small,0.2,0.3,0.4,0.1,5,12\\nBig,0.5,0.5,0.5,0.3,7,60\\n")
    >>> found = deepfield.catalogue("clusters.csv")
    >>> found
    <table of 2 rows: name, x [kpc], y [kpc], z [kpc], radius [kpc], mass [Msun], richness>
    >>> list(found["name"]), found["richness"].tolist()
    (['Big', 'Small'], [60.0, 12.0])
    >>> data.probe(at="clusters.csv#Big")["count"] == data.probe(sphere=(0.5, 0.5, 0.5, 0.3))["count"]
    True
    """
    wanted = {
        "time": None if time is None else str(time),
        "fields": asked.listed("fields", fields),
        "memory": asked.memory(memory),
    }
    with progresses.teller(progress) as tell:
        columns, about, told = _deepfield.catalogue(files.expanded(path), asked.text(wanted), tell)
    notes.tell(told)
    about = json.loads(about)
    units, kinds = about.pop("units"), about.pop("kinds")
    # Texts of any length take their own room, and not that of the longest.
    columns["name"] = np.array(columns["name"], dtype=object)
    return Table(columns, units, {"kind": kinds} if "kind" in columns else {}, about)
