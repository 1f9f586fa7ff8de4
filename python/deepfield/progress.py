"""Who is told how far work has come: a callable, or a bar."""

import contextlib
import sys


class _Bar:
    """A bar of tqdm for each stage."""

    def __init__(self, tqdm):
        self._tqdm, self._stage, self._bar = tqdm, None, None

    def __call__(self, stage, done, total):
        if stage != self._stage:
            self.close()
            self._stage, self._bar = stage, self._tqdm(total=total or None, desc=stage, leave=False)
        # How many there are may become known on the way.
        self._bar.n, self._bar.total = done, total or None
        self._bar.refresh()

    def close(self):
        if self._bar is not None:
            self._bar.close()


class _Line:
    """A line on standard error, written anew."""

    def __init__(self):
        self._length = 0

    def _write(self, line):
        sys.stderr.write("\r" + line.ljust(self._length))
        sys.stderr.flush()
        self._length = len(line)

    def __call__(self, stage, done, total):
        counted = f": {100 * done // total} %" if total else f": {done}" if done else ""
        self._write(stage + counted)

    def close(self):
        if self._length:
            self._write("")
            sys.stderr.write("\r")


def _bar():
    try:
        from tqdm.auto import tqdm  # type: ignore
    except ImportError:
        return _Line()
    return _Bar(tqdm)


@contextlib.contextmanager
def teller(progress):
    """What is called with the stage, the steps done and their number: ``progress`` itself, a bar for True, and None for None and False."""
    if progress is not True:
        yield progress or None
        return
    bar = _bar()
    try:
        yield bar
    finally:
        bar.close()
