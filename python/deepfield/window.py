"""The program's window, in a process of its own."""

import os
import pathlib
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import threading

from ._deepfield import Error


def program():
    """The program: the one that DEEPFIELD_PROGRAM names, else the wheel's own, else the first one on the path."""
    named = os.environ.get("DEEPFIELD_PROGRAM")
    own = pathlib.Path(sysconfig.get_path("scripts"), "deepfield.exe" if sys.platform == "win32" else "deepfield")
    found = named or (str(own) if own.is_file() else shutil.which("deepfield"))
    if found is None:
        raise Error("view: program: found no `deepfield`, expected it on the path (docs/installing.md)")
    return found


def open_window(scene):
    """Shows a scene; gives the process, which ends with the window."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise Error("view: display: found none, expected one: data.widget() and data.render() need none")
    command = program()
    folder = tempfile.TemporaryDirectory(prefix="deepfield-", ignore_cleanup_errors=True)
    file = os.path.join(folder.name, "view.scene.ron")
    scene.write(file)
    try:
        process = subprocess.Popen([command, "view", file], stdin=subprocess.DEVNULL)
    except OSError as error:
        folder.cleanup()
        raise Error(f"{command}: {error.strerror}") from None

    def attend():
        process.wait()
        folder.cleanup()

    # The scene is there as long as the window, which may be longer than whoever asked for it.
    threading.Thread(target=attend, daemon=True).start()
    return process
