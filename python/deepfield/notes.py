"""What there is to tell while data is opened, built and drawn."""

import warnings


class Note(UserWarning):
    """A sentence that the program says on standard error: what was assumed, left out or drawn coarser."""


def tell(notes, stacklevel=3):
    """Warns once for each note, at the place that called the package."""
    for note in notes:
        warnings.warn(note, Note, stacklevel=stacklevel)
