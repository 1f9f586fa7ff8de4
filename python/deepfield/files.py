"""Files that are read, and written as a whole or not at all."""

import contextlib
import os
import stat
import threading

from ._deepfield import Error


def expanded(path):
    """A path that a user names, as a text: ``~`` at its beginning is the folder of whom it says, as to a shell."""
    return os.path.expanduser(os.fspath(path))


def whole_path(path, folder=""):
    """A path, which is from a folder [the current one] where it is relative, from the root on; a URL as it is."""
    path = os.fspath(path)
    is_url = path.lower().startswith(("http://", "https://", "s3://"))
    return path if is_url else os.path.abspath(os.path.join(folder, path))


def folder_of(path):
    """The folder of a file, from the root on."""
    return os.path.dirname(os.path.abspath(os.fspath(path)))


def read(path):
    """The text of a file."""
    path = expanded(path)
    try:
        with open(path, encoding="utf-8") as file:
            return file.read()
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise Error(f"{path}: found bytes that are no text, expected a text in RON") from None


def write(path, text):
    """Writes a text in RON, over nothing but such a text: what else is there may be what pictures are of."""
    path = expanded(path)
    if os.path.isfile(path) and not _is_ron(path):
        raise Error(f"{path}: cannot be written: found a file that is no text in RON, expected another name")
    with written(path) as file:
        file.write(text.rstrip("\n").encode() + b"\n")


def _is_ron(path):
    """Whether a file begins as texts in RON do, or is empty."""
    try:
        with open(path, "rb") as file:
            start = file.read(4096).lstrip()
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None
    return b"\0" not in start and (not start or start.startswith((b"(", b"//", b"/*", b"#![")))


def refuse(path, sources):
    """Refuses to write over one of the files that are read."""
    place = os.path.realpath(path)
    if os.path.exists(place) and any(os.path.realpath(one) == place for one in sources):
        raise Error(f"{os.fspath(path)}: cannot be written: found a file that is read, expected another name")


@contextlib.contextmanager
def written(path):
    """A file of bytes that is there under its name once all is written; what fails leaves nothing, and what was there as it was."""
    path = os.fspath(path)
    # The file that a link leads to is replaced, and not the link.
    place = os.path.realpath(path)
    own = f".deepfield-{os.getpid()}-{threading.get_ident()}"
    try:
        if os.path.exists(path) and not stat.S_ISREG(os.stat(path).st_mode):
            # Pipes and devices are no files that could be replaced.
            with open(path, "wb") as file:
                yield file
            return
        part = os.path.join(os.path.dirname(place), own)
        try:
            with open(part, "wb") as file:
                yield file
            os.replace(part, place)
        except BaseException:
            with contextlib.suppress(OSError):
                os.remove(part)
            raise
    except OSError as error:
        raise Error(f"{path}: cannot be written: {error.strerror or error}") from None
