"""The wheel: what pip checks when it installs it."""

import base64
import csv
import hashlib
import importlib.util
import io
import os
import pathlib
import struct
import subprocess
import sys
import sysconfig
import tempfile
import unittest
import unittest.mock
import zipfile

import deepfield
from deepfield import window

HERE = pathlib.Path(__file__).resolve().parent
LIBRARY = b"\0GLIBC_2.17\0GLIBC_2.28\0GLIBC_2.4\0"


@unittest.skipUnless((HERE.parent / "wheel.py").is_file() and sys.platform == "linux", "no wheel.py, or no Linux")
class Wheels(unittest.TestCase):
    def setUp(self):
        spec = importlib.util.spec_from_file_location("wheel", HERE.parent / "wheel.py")
        self.wheel = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.wheel)

    def built(self, folder, **more):
        package = {"version": "1.2.3", "license": "MIT OR Apache-2.0"}
        return self.wheel.wheel(package, LIBRARY, pathlib.Path(folder), **more)

    def test_every_file_is_recorded_as_it_is(self):
        more = {"program": b"\0GLIBC_2.5\0GLIBC_2.31\0", "linked": b"that of another package"}
        with tempfile.TemporaryDirectory() as folder:
            self.assertRegex(self.built(folder).name, r"^deepfield-1\.2\.3-cp311-abi3-manylinux_2_28_\w+\.whl$")
            path = self.built(folder, **more)
            self.assertRegex(path.name, r"-manylinux_2_31_\w+\.whl$")
            first = path.read_bytes()
            self.assertEqual(self.built(folder, **more).read_bytes(), first)
            with zipfile.ZipFile(path) as archive:
                files = {name: archive.read(name) for name in archive.namelist()}
            with zipfile.ZipFile(self.built(folder, **more, is_packed=False)) as archive:
                self.assertEqual({name: archive.read(name) for name in archive.namelist()}, files)
        about = "deepfield-1.2.3.dist-info"
        self.assertEqual(files["deepfield-1.2.3.data/scripts/deepfield"], more["program"])
        named = [line.split(": ")[1] for line in files[f"{about}/METADATA"].decode().splitlines() if line.startswith("License-File: ")]
        self.assertEqual(sorted(f"{about}/licenses/{name}" for name in named), sorted(name for name in files if "/licenses/" in name))
        self.assertEqual(files[f"{about}/licenses/LICENSES-THIRD-PARTY"], more["linked"])
        rows = list(csv.reader(io.StringIO(files[f"{about}/RECORD"].decode())))
        self.assertEqual(sorted(row[0] for row in rows), sorted(files))
        for name, digest, size in rows:
            if digest:
                found = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest()).rstrip(b"=").decode()
                self.assertEqual((digest, int(size)), (f"sha256={found}", len(files[name])))
        self.assertEqual(files["deepfield/_deepfield.abi3.so"], LIBRARY)
        for name in ("deepfield/__init__.py", "deepfield/__init__.pyi", "deepfield/py.typed", "deepfield/widget.js", f"{about}/licenses/LICENSE-MIT"):
            self.assertIn(name, files)

    @unittest.skipUnless(importlib.util.find_spec("pip"), "pip is not installed")
    def test_pip_installs_the_program(self):
        with tempfile.TemporaryDirectory() as folder:
            path = self.built(folder, program=b"#!/bin/sh\necho deepfield $1\n")
            into = pathlib.Path(folder, "into")
            options = ("--quiet", "--no-index", "--no-deps", "--no-compile", "--disable-pip-version-check", "--root-user-action=ignore")
            subprocess.run([sys.executable, "-m", "pip", "install", *options, "--target", into, path], check=True)
            said = subprocess.run([into / "bin" / "deepfield", "info"], check=True, stdout=subprocess.PIPE, text=True).stdout
        self.assertEqual(said, "deepfield info\n")

    def test_on_macos_the_name_says_what_the_files_are_compiled_for(self):
        def compiled(processor, major, minor, command=0x32):
            version = struct.pack("<I", major << 16 | minor << 8)
            other = struct.pack("<2I8x", 0x1B, 16)
            named = struct.pack("<3I", 0x32, 24, 1) + version + bytes(8) if command == 0x32 else struct.pack("<2I", 0x24, 16) + version + bytes(4)
            return struct.pack("<8I", 0xFEEDFACF, processor, 0, 6, 2, len(other + named), 0, 0) + other + named

        intel, apple = 0x01000007, 0x0100000C
        with unittest.mock.patch.object(sys, "platform", "darwin"):
            tag = self.wheel.platform_tag
            self.assertEqual(tag(compiled(apple, 11, 0), b""), "macosx_11_0_arm64")
            self.assertEqual(tag(compiled(intel, 10, 12, 0x24), compiled(intel, 10, 9)), "macosx_10_12_x86_64")
            self.assertEqual(tag(compiled(apple, 11, 0), compiled(apple, 12, 3)), "macosx_13_0_arm64")
            whole = compiled(apple, 11, 0)
            # For two processors, in one file for both, and one whose first load command is all that it has.
            for files in ((whole, compiled(intel, 11, 0)), (b"\xca\xfe\xba\xbe" + bytes(16),), (whole[:16] + struct.pack("<I", 1) + whole[20:],)):
                with self.assertRaisesRegex(SystemExit, "wheel.py: found"):
                    tag(*files)

    def test_a_library_that_needs_libpython_is_refused(self):
        with self.assertRaisesRegex(SystemExit, "PYO3_BUILD_EXTENSION_MODULE"):
            self.wheel.platform_tag(b"\0libpython3.11.so.1.0\0GLIBC_2.17\0")


PROGRAM = pathlib.Path(sysconfig.get_path("scripts"), "deepfield.exe" if sys.platform == "win32" else "deepfield")


@unittest.skipUnless(PROGRAM.is_file(), "the package was installed without the program")
class Installed(unittest.TestCase):
    def test_the_program_that_the_wheel_brought_is_found_and_runs(self):
        with unittest.mock.patch.dict(os.environ):
            os.environ.pop("DEEPFIELD_PROGRAM", None)
            self.assertEqual(window.program(), str(PROGRAM))
        said = subprocess.run([PROGRAM, "--version"], check=True, stdout=subprocess.PIPE, text=True).stdout
        self.assertEqual(said, f"deepfield {deepfield.__version__}\n")


if __name__ == "__main__":
    unittest.main()
