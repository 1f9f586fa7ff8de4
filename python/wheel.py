#!/usr/bin/env python3
"""Builds the wheel of the package `deepfield`, with cargo and Python's standard library alone.

    python3 python/wheel.py                      # compiles, and writes python/dist/deepfield-VERSION-cp311-abi3-PLATFORM.whl
    python3 python/wheel.py --library PATH       # of a library that is compiled already

One wheel does for every CPython from 3.11 on: it has the stable interface alone. On Linux its name says which glibc it needs, by the newest
symbols that the library asks for; built on an old distribution it runs on more.
"""

import argparse
import base64
import hashlib
import json
import os
import pathlib
import platform
import re
import subprocess
import sys
import sysconfig
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent
# Archives of the same files are the same.
DATE = (1980, 1, 1, 0, 0, 0)


def cargo(*arguments, **environment):
    command = [os.environ.get("CARGO", "cargo"), *arguments, "--manifest-path", str(HERE / "Cargo.toml")]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, cwd=ROOT, env={**os.environ, **environment}).stdout


def compiled(metadata, profile):
    """Compiles the library, not linked with an interpreter's."""
    cargo("build", "--locked", "--package", "deepfield-python", "--profile", profile, PYO3_BUILD_EXTENSION_MODULE="1")
    folder = pathlib.Path(metadata["target_directory"]) / ("debug" if profile == "dev" else profile)
    names = {"darwin": "lib_deepfield.dylib", "win32": "_deepfield.dll"}
    return folder / names.get(sys.platform, "lib_deepfield.so")


def platform_tag(library):
    """The platforms that a library runs on (PEP 600)."""
    if sys.platform != "linux":
        return re.sub(r"[-.]", "_", sysconfig.get_platform())
    if re.search(rb"libpython3[.\w]*\.so", library):
        sys.exit("wheel.py: the library is linked with libpython: compile it with PYO3_BUILD_EXTENSION_MODULE=1")
    needed = [int(minor) for minor in re.findall(rb"GLIBC_2\.(\d+)", library)]
    machine = platform.machine()
    return f"manylinux_2_{max(needed)}_{machine}" if needed else f"linux_{machine}"


def metadata_text(package):
    lines = [
        "Metadata-Version: 2.4",
        "Name: deepfield",
        f"Version: {package['version']}",
        "Summary: Pictures of huge point data, volumes and height fields, with an error that is guaranteed",
        f"License-Expression: {package['license']}",
        "License-File: LICENSE-APACHE",
        "License-File: LICENSE-MIT",
        "Requires-Python: >=3.11",
        "Requires-Dist: numpy>=1.26",
        "Description-Content-Type: text/markdown",
        "",
        (ROOT / "docs" / "python.md").read_text(encoding="utf-8"),
    ]
    return "\n".join(lines)


def wheel(package, library, folder):
    """Writes the wheel (the binary distribution format, https://packaging.python.org/specifications/binary-distribution-format)."""
    version = package["version"].replace("-", "_")
    tag = f"cp311-abi3-{platform_tag(library)}"
    about = f"deepfield-{version}.dist-info"
    files = {
        f"deepfield/{path.name}": path.read_bytes()
        for path in sorted((HERE / "deepfield").iterdir())
        if path.suffix in (".py", ".pyi", ".typed") or path.name == "py.typed"
    }
    files["deepfield/_deepfield.pyd" if sys.platform == "win32" else "deepfield/_deepfield.abi3.so"] = library
    for name in ("LICENSE-APACHE", "LICENSE-MIT"):
        files[f"{about}/licenses/{name}"] = (ROOT / name).read_bytes()
    files[f"{about}/METADATA"] = metadata_text(package).encode()
    text = f"Wheel-Version: 1.0\nGenerator: deepfield wheel.py\nRoot-Is-Purelib: false\nTag: {tag}\n"
    files[f"{about}/WHEEL"] = text.encode()
    record = ""
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record += f"{name},sha256={digest},{len(content)}\n"
    files[f"{about}/RECORD"] = f"{record}{about}/RECORD,,\n".encode()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"deepfield-{version}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
            archive.writestr(entry, content)
    return path


def main():
    parser = argparse.ArgumentParser(description="Builds the wheel of the package deepfield.")
    parser.add_argument("--library", type=pathlib.Path, help="the compiled library [default: it is compiled]")
    parser.add_argument("--profile", default="release", help="cargo's profile [default: release]")
    parser.add_argument("--out", type=pathlib.Path, default=HERE / "dist", help="folder of the wheel [default: python/dist]")
    arguments = parser.parse_args()
    metadata = json.loads(cargo("metadata", "--format-version", "1", "--no-deps", "--offline"))
    package = next(package for package in metadata["packages"] if package["name"] == "deepfield-python")
    library = arguments.library or compiled(metadata, arguments.profile)
    print(wheel(package, library.read_bytes(), arguments.out))


if __name__ == "__main__":
    main()
