#!/usr/bin/env python3
"""Tries the package as it is installed: builds its wheel of the library and the program that `cargo test-all` compiles, installs it into an empty
environment, and there runs the tests of this folder and compares the stubs with what they describe.

    python3 python/tests/run.py                  # `cargo test-all` ends with it

What the machine lacks is told in one line and left out. DEEPFIELD_PYTHON_TESTS=require makes that a failure.
"""

import os
import pathlib
import subprocess
import sys
import sysconfig
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))

# What tests can do without, and what is not tried then.
OPTIONAL = {
    "matplotlib": "figures of the notebook",
    "anywidget": "the widget's own messages",
    "pyarrow": "tables that Arrow reads",
    "pandas": "data frames",
    "h5py": "snapshots that HDF5's own library reads",
    "astropy": "tables that astropy reads",
    "plyfile": "points that plyfile reads",
    "pynbody": "snapshots of pynbody",
    "swiftsimio": "data sets of swiftsimio",
    "yt": "data sets of yt",
    "distributed": "builds by the workers of Dask",
    "mypy": "the stubs",
}

# Of what is only tried, the outcome is told.
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


class Missing(Exception):
    """What the machine lacks, and with it is not tested."""


def leave_out(what):
    """Tells what is not tested; whether that is a failure."""
    print(f"{what}.", flush=True)
    return os.environ.get("DEEPFIELD_PYTHON_TESTS") == "require"


def runs(*command, **settings):
    return subprocess.run([str(part) for part in command], **settings).returncode == 0


class Environment:
    """An environment with NumPy: of its own, or where none can be had that of the interpreter that this runs in."""

    def __init__(self, folder):
        self.packages = pathlib.Path(sysconfig.get_path("purelib", "venv", vars={"base": str(folder)}))
        self.python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
        self.is_online = self._is_made(folder) and self.installs("numpy>=1.26", **QUIET)
        if not self.is_online and not (self._is_made(folder, "--system-site-packages") and self.imports("numpy")):
            raise Missing("NumPy" if self.python.exists() else "venv")

    def _is_made(self, folder, *options):
        return runs(sys.executable, "-m", "venv", "--clear", *options, folder, **QUIET)

    def installs(self, *what, **settings):
        options = ("--quiet", "--no-compile", "--retries", "1", "--disable-pip-version-check")
        return runs(self.python, "-m", "pip", "install", *options, *what, **settings)

    def imports(self, package):
        return runs(self.python, "-c", f"import {package}", **QUIET)

    def lacks(self, packages, folder):
        """Those that are neither there nor to be had. They stay in a folder, which takes a while to fill, and come after the environment's own.

        Python compiles what is imported of them, and leaves that there; pip would compile all.
        """
        folder.mkdir(parents=True, exist_ok=True)
        (self.packages / "optional.pth").write_text(f"{folder}\n", encoding="utf-8")
        absent = [package for package in packages if not self.imports(package)]
        if not absent or not self.is_online:
            return absent
        into = ("--upgrade", "--target", folder)
        if not self.installs(*into, *absent, **QUIET):
            # What can be had of them.
            for package in absent:
                self.installs(*into, package, **QUIET)
        return [package for package in absent if not self.imports(package)]


def tested(folder):
    """Whether everything passes that can be tried."""
    if sys.version_info < (3, 11):
        raise Missing("Python from 3.11 on")
    import wheel

    environment = Environment(folder / "environment")
    metadata, package = wheel.described()
    library = wheel.compiled(metadata, "dev")
    compiled = wheel.output_folder(metadata, "dev")
    program = compiled / ("deepfield.exe" if sys.platform == "win32" else "deepfield")
    # It is installed once.
    built = wheel.wheel(package, library.read_bytes(), folder, program=program.read_bytes(), is_packed=False)
    # What else an interpreter has, whose packages are shared, may be broken as it likes.
    is_complete = environment.installs("--no-index", built) and (
        not environment.is_online or runs(environment.python, "-m", "pip", "check")
    )
    if not is_complete:
        raise SystemExit(f"{built.name}: not installed")
    kept = compiled / "python" / sys.implementation.cache_tag
    absent = environment.lacks(OPTIONAL, kept)
    passed = [not leave_out(f"Not tested, for lack of {package}: {OPTIONAL[package]}") for package in absent]

    own = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    own.setdefault("DEEPFIELD_PROGRAM", str(environment.python.with_name(program.name)))
    # Nothing is found in the user's cache, nor left there; matplotlib looks for fonts once.
    own |= {"XDG_CACHE_HOME": str(folder / "cache"), "LOCALAPPDATA": str(folder / "cache")}
    own |= {"MPLBACKEND": "agg", "MPLCONFIGDIR": str(kept / "matplotlib-fonts")}
    passed.append(runs(environment.python, "-m", "unittest", "discover", HERE, cwd=folder, env=own))
    if "mypy" not in absent:
        settings = ("--mypy-config-file", HERE.parent / "pyproject.toml", "--allowlist", HERE / "stubtest.txt", "--ignore-unused-allowlist")
        passed.append(runs(environment.python, "-m", "mypy.stubtest", "deepfield", "--concise", *settings, cwd=folder, env=own))
    return all(passed)


def main():
    with tempfile.TemporaryDirectory(prefix="deepfield-python-") as folder:
        try:
            passed = tested(pathlib.Path(folder))
        except Missing as missing:
            passed = not leave_out(f"The Python package was not tested: no {missing}")
    sys.exit(not passed)


if __name__ == "__main__":
    main()
