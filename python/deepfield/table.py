"""Tables: columns of NumPy with names and units, which other packages take without a copy."""

import numpy as np

from . import _deepfield

_ARROW_TYPES = (np.float32, np.float64, np.int64, np.uint64)


class Table:
    """Rows as columns of one length.

    ``table["temperature"]`` is a column, ``table[["x", "y"]]`` a table of some columns, ``table[mask]`` and ``table[10:20]`` one of some rows,
    ``len(table)`` their number, ``units`` are by name, and ``about`` is what else is known: of a selection whether values are the source's own
    (``exact``).

    ``pandas.DataFrame`` comes from :meth:`to_pandas`; pyarrow, polars, DuckDB and others read it by ``__arrow_c_stream__``:
    ``pyarrow.table(table)``, ``polars.DataFrame(table)``.

    >>> table = deepfield.Table({"x": np.arange(4.0), "id": np.arange(4)}, {"x": "kpc"})
    >>> table[table["x"] > 1.0]
    <table of 2 rows: x [kpc], id>
    """

    def __init__(self, columns, units=None, words=None, about=None):
        """``words`` gives columns of numbers (uint16) the texts that these stand for."""
        self._columns = {name: np.asanyarray(column) for name, column in dict(columns).items()}
        self._words = dict(words or {})
        self.units = dict(units or {})
        self.about = dict(about or {})
        wrong = next((name for name, column in self._columns.items() if column.ndim == 0), None)
        if wrong is not None:
            raise _deepfield.Error(f"table: {wrong}: found a single value, expected a column")
        lengths = {len(column) for column in self._columns.values()}
        if len(lengths) > 1:
            raise _deepfield.Error(f"table: found columns of {sorted(lengths)} rows, expected one length")
        self._length = lengths.pop() if lengths else 0

    @property
    def columns(self):
        """The names of its columns."""
        return list(self._columns)

    def keys(self):
        """The names of its columns, so that ``dict(table)`` is what they hold."""
        return self._columns.keys()

    def __len__(self):
        return self._length

    def __iter__(self):
        return iter(self._columns)

    def __contains__(self, name):
        return name in self._columns

    def __getitem__(self, which):
        if isinstance(which, str):
            column = self._column(which)
            return np.array(self._words[which] or [""])[column] if which in self._words else column
        if isinstance(which, list) and which and all(isinstance(name, str) for name in which):
            return Table({name: self._column(name) for name in which}, self.units, self._words, self.about)
        rows = {name: np.atleast_1d(column[which]) for name, column in self._columns.items()}
        return Table(rows, self.units, self._words, self.about)

    def _column(self, name):
        if name not in self._columns:
            raise KeyError(f"found {name}, expected one of {', '.join(self._columns)}")
        return self._columns[name]

    def __array__(self, dtype=None, copy=None):
        # NumPy and pandas.DataFrame() would else take the names of its columns for what it holds.
        raise TypeError("a table is no array: its columns are, table[name], and table.to_pandas() is a data frame")

    def to_pandas(self):
        """A ``pandas.DataFrame``; units are in its ``attrs``.

        >>> frame = deepfield.Table({"x": np.arange(3.0)}, {"x": "kpc"}).to_pandas()
        >>> frame["x"].tolist(), frame.attrs["units"]
        ([0.0, 1.0, 2.0], {'x': 'kpc'})
        """
        import pandas  # type: ignore

        def column(name):
            if name not in self._words:
                return self._columns[name]
            return pandas.Categorical.from_codes(self._columns[name].astype(np.int64), self._words[name])

        frame = pandas.DataFrame({name: column(name) for name in self})
        frame.attrs["units"] = dict(self.units)
        return frame

    def _arrow_column(self, name):
        column = np.ascontiguousarray(self._columns[name])
        if name in self._words:
            return column, self._words[name]
        if column.dtype.kind == "U" or (column.dtype.kind == "O" and all(isinstance(text, str) for text in column)):
            return column.tolist()
        if column.dtype.type in _ARROW_TYPES and column.dtype.isnative:
            return column
        if column.dtype.kind in "biu":
            return column.astype(np.uint64 if column.dtype.kind == "u" else np.int64)
        return column.astype(np.float64)

    def __arrow_c_stream__(self, requested_schema=None):
        """A capsule of the Arrow C stream interface; numbers are not copied, and units are metadata of their fields."""
        columns = [(name, self.units.get(name, ""), self._arrow_column(name)) for name in self]
        return _deepfield.arrow_stream(columns)

    def __repr__(self):
        names = (f"{name} [{self.units[name]}]" if self.units.get(name) else name for name in self)
        return f"<table of {self._length:,} rows: {', '.join(names)}>".replace(",", " ", f"{self._length:,}".count(","))
