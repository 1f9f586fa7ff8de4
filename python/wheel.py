#!/usr/bin/env python3
"""Builds the wheel of the package `deepfield`, with cargo and Python's standard library alone.

    python3 python/wheel.py                      # compiles, and writes python/dist/deepfield-VERSION-cp311-abi3-PLATFORM.whl
    python3 python/wheel.py --library PATH       # of a library that is compiled already
    python3 python/wheel.py --program PATH       # with the program, which pip puts beside Python as `deepfield`
    python3 python/wheel.py --glibc 2.28         # for Linux with a glibc as old as that, by cargo-zigbuild (pip install cargo-zigbuild)
    python3 python/wheel.py --profile dev        # of the library that belongs to `cargo test-all`, and of what that has compiled

One wheel does for every CPython from 3.11 on: it has the stable interface alone. On Linux its name says which glibc it needs, by the newest
symbols that the library and the program ask for; built on an old distribution, or with `--glibc`, it runs on more. On macOS it says which
version and processor they are compiled for (`MACOSX_DEPLOYMENT_TARGET`). The licences of all that is linked into them are in it.
"""

import argparse
import base64
import hashlib
import json
import os
import pathlib
import platform
import re
import stat
import struct
import subprocess
import sys
import sysconfig
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent
# Archives of the same files are the same.
DATE = (1980, 1, 1, 0, 0, 0)
# What files of macOS for one processor begin with, their processors by number, and where the load commands that name the oldest macOS have it.
MACH_O = 0xFEEDFACF
PROCESSORS = {0x01000007: "x86_64", 0x0100000C: "arm64"}
OLDEST_AT = {0x32: 12, 0x24: 8}


# In the root, so that cargo reads .cargo/config.toml, which has the library not linked with an interpreter's.
def cargo(*arguments):
    command = [os.environ.get("CARGO", "cargo"), *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, cwd=ROOT)
    if done.returncode:
        sys.exit(f"wheel.py: cargo {arguments[0]}: failed")
    return done.stdout


def output_folder(metadata, profile, glibc=None):
    """Where cargo puts what it compiles, for a glibc 2 of its own where its minor version is given."""
    folder = pathlib.Path(metadata["target_directory"])
    return (folder if glibc is None else folder / linux_target()) / ("debug" if profile == "dev" else profile)


def linux_target():
    """The target of a Linux on this machine."""
    return f"{platform.machine()}-unknown-linux-gnu"


def minor_of_glibc(text):
    """The minor version of a glibc 2 that is asked for: 28 of `2.28`."""
    if sys.platform != "linux":
        raise argparse.ArgumentTypeError(f"found {sys.platform}, expected linux")
    if not (minor := re.fullmatch(r"2\.(\d{1,3})", text)):
        raise argparse.ArgumentTypeError(f"found {text}, expected 2 and a minor version, as in 2.28")
    return int(minor[1])


def built(metadata, profile, *chosen, glibc=None):
    """Compiles what is chosen; returns the folder of what cargo makes."""
    # Zig brings the symbols of every glibc to link with, and a compiler of C for what C there is.
    command = ["build"] if glibc is None else ["zigbuild", "--target", f"{linux_target()}.2.{glibc}"]
    cargo(*command, "--locked", *chosen, "--profile", profile)
    return output_folder(metadata, profile, glibc)


def compiled(metadata, profile, glibc=None):
    """Compiles the library."""
    # Features of dependencies are united over the packages that cargo builds, those that only tests ask for where it builds a test
    # (resolver 3). With all packages and one test of theirs they are those of `cargo test --workspace`, so that nothing but this library and
    # what it alone depends on is compiled anew. A release needs no Bevy.
    chosen = ("--workspace", "--lib", "--test", "processor") if profile == "dev" else ("--package", "deepfield-python")
    names = {"darwin": "lib_deepfield.dylib", "win32": "_deepfield.dll"}
    return built(metadata, profile, *chosen, glibc=glibc) / names.get(sys.platform, "lib_deepfield.so")


def described():
    """What cargo says of the workspace, and of the library's package."""
    metadata = json.loads(cargo("metadata", "--format-version", "1", "--no-deps", "--offline"))
    return metadata, next(package for package in metadata["packages"] if package["name"] == "deepfield-python")


def platform_tag(*binaries):
    """The platforms that libraries and programs run on (PEP 600)."""
    if sys.platform == "darwin":
        return macos_tag(*filter(None, binaries))
    if sys.platform != "linux":
        return re.sub(r"[-.]", "_", sysconfig.get_platform())
    if any(re.search(rb"libpython3[.\w]*\.so", binary) for binary in binaries):
        sys.exit("wheel.py: the library is linked with libpython: compile it with PYO3_BUILD_EXTENSION_MODULE=1")
    needed = [int(minor) for binary in binaries for minor in re.findall(rb"GLIBC_2\.(\d+)", binary)]
    machine = platform.machine()
    return f"manylinux_2_{max(needed)}_{machine}" if needed else f"linux_{machine}"


def macos_tag(*binaries):
    """The macOS and the processor that all of them are compiled for, as they say themselves: the interpreter may be for others as well."""
    oldest, processors = [], set()
    for binary in binaries:
        magic, processor, _, _, commands = struct.unpack_from("<5I", binary)
        if magic != MACH_O or processor not in PROCESSORS:
            sys.exit(f"wheel.py: found a file for other processors, expected Mach-O for one of {', '.join(PROCESSORS.values())}")
        processors.add(PROCESSORS[processor])
        at = 32
        for _ in range(commands):
            command, size = struct.unpack_from("<2I", binary, at)
            if command in OLDEST_AT:
                (version,) = struct.unpack_from("<I", binary, at + OLDEST_AT[command])
                oldest.append((version >> 16, version >> 8 & 0xFF))
            at += size
    if len(processors) != 1 or not oldest:
        sys.exit(f"wheel.py: found processors {sorted(processors)} and versions {oldest}, expected one processor and a version")
    major, minor = max(oldest)
    # From 11 on pip knows no minor versions: what one needs that is not 0 the next major version has.
    major, minor = (major, minor) if major < 11 else (major + (minor > 0), 0)
    return f"macosx_{major}_{minor}_{processors.pop()}"


def notices(*packages):
    """The licences of the packages that are linked into packages of the workspace."""
    chosen = [word for package in packages for word in ("--package", package)]
    tree = cargo("tree", "--locked", *chosen, "--edges", "normal", "--prefix", "none", "--format", "{p}\t{l}")
    home = pathlib.Path(os.environ.get("CARGO_HOME") or pathlib.Path.home() / ".cargo")
    texts, lacking = {}, []
    for line in sorted({line.removesuffix(" (*)") for line in tree.decode().splitlines()}):
        # What belongs to the workspace has a path after its version.
        package = re.fullmatch(r"(\S+) v(\S+)(?: \(proc-macro\))?\t(.*)", line)
        if not package:
            continue
        name = f"{package[1]} {package[2]}: {package[3]}"
        files = [file for folder in home.glob(f"registry/src/*/{package[1]}-{package[2]}") for file in licence_files(folder)]
        if not files:
            lacking.append(name)
        for file in files:
            texts.setdefault(file.read_text("utf-8", "replace").strip(), []).append(name)
    if lacking:
        print(f"{len(lacking)} packages bring no file with their licence: it is listed by its name", file=sys.stderr)
        texts["The packages above bring no file with their licence."] = lacking
    rule = "\n\n" + 80 * "-" + "\n\n"
    return rule.join("\n".join([*dict.fromkeys(names), "", text]) for text, names in texts.items()).encode()


def licence_files(folder):
    """The files of a package that hold its licences, and those of the fonts and the C sources in it."""
    names = ("LICENSE", "LICENCE", "NOTICE", "COPYRIGHT", "OFL", "UFL")
    for place, folders, files in os.walk(folder):
        folders.sort()
        # C sources have the GPL beside a LICENSE to choose, as `COPYING`.
        own = (*names, "COPYING") if place == str(folder) else names
        for name in sorted(files):
            if name.upper().startswith(own) and not name.endswith(".rs"):
                yield pathlib.Path(place, name)


def metadata_text(package, licences):
    lines = [
        "Metadata-Version: 2.4",
        "Name: deepfield",
        f"Version: {package['version']}",
        "Summary: Pictures of huge point data, volumes and height fields, with an error that is guaranteed",
        f"License-Expression: {package['license']}",
        *(f"License-File: {name}" for name in licences),
        "Requires-Python: >=3.11",
        "Requires-Dist: numpy>=1.26",
        "Description-Content-Type: text/markdown",
        "",
        (ROOT / "docs" / "python.md").read_text(encoding="utf-8"),
    ]
    return "\n".join(lines)


def wheel(package, library, folder, *, program=None, linked=None, is_packed=True):
    """Writes the wheel of a library, with a program and the licences of what is `linked` into them where they are given (the binary
    distribution format, https://packaging.python.org/specifications/binary-distribution-format). Packing takes longer than all else."""
    version = package["version"].replace("-", "_")
    tag = f"cp311-abi3-{platform_tag(library, program or b'')}"
    about, scripts = f"deepfield-{version}.dist-info", f"deepfield-{version}.data/scripts/"
    files = {
        f"deepfield/{path.name}": path.read_bytes()
        for path in sorted((HERE / "deepfield").iterdir())
        if path.suffix in (".py", ".pyi", ".js") or path.name == "py.typed"
    }
    files["deepfield/_deepfield.pyd" if sys.platform == "win32" else "deepfield/_deepfield.abi3.so"] = library
    if program is not None:
        files[scripts + ("deepfield.exe" if sys.platform == "win32" else "deepfield")] = program
    licences = {name: (ROOT / name).read_bytes() for name in ("LICENSE-APACHE", "LICENSE-MIT")}
    if linked is not None:
        licences["LICENSES-THIRD-PARTY"] = linked
    files.update({f"{about}/licenses/{name}": text for name, text in licences.items()})
    files[f"{about}/METADATA"] = metadata_text(package, licences).encode()
    text = f"Wheel-Version: 1.0\nGenerator: deepfield wheel.py\nRoot-Is-Purelib: false\nTag: {tag}\n"
    files[f"{about}/WHEEL"] = text.encode()
    record = ""
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record += f"{name},sha256={digest},{len(content)}\n"
    files[f"{about}/RECORD"] = f"{record}{about}/RECORD,,\n".encode()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"deepfield-{version}-{tag}.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED if is_packed else zipfile.ZIP_STORED
            # Of what is no regular file pip makes no program.
            entry.external_attr = (stat.S_IFREG | (0o755 if name.endswith(".so") or name.startswith(scripts) else 0o644)) << 16
            archive.writestr(entry, content)
    return path


def main():
    parser = argparse.ArgumentParser(description="Builds the wheel of the package deepfield.")
    parser.add_argument("--library", type=pathlib.Path, help="the compiled library [default: it is compiled]")
    parser.add_argument("--program", type=pathlib.Path, help="the compiled program, to be in the wheel, too [default: it is not]")
    parser.add_argument("--profile", default="release", help="cargo's profile [default: release]")
    parser.add_argument("--glibc", type=minor_of_glibc, metavar="2.MINOR", help="the glibc to compile for [default: this machine's]")
    parser.add_argument("--out", type=pathlib.Path, default=HERE / "dist", help="folder of the wheel [default: python/dist]")
    arguments = parser.parse_args()
    metadata, package = described()
    library = arguments.library or compiled(metadata, arguments.profile, arguments.glibc)
    program = arguments.program and arguments.program.read_bytes()
    linked = notices(package["name"], *(["deepfield"] if arguments.program else []))
    print(wheel(package, library.read_bytes(), arguments.out, program=program, linked=linked))


if __name__ == "__main__":
    main()
