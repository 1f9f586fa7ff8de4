"""The wheel: what pip checks when it installs it."""

import base64
import csv
import hashlib
import importlib.util
import io
import pathlib
import sys
import tempfile
import unittest
import zipfile

HERE = pathlib.Path(__file__).resolve().parent


@unittest.skipUnless((HERE.parent / "wheel.py").is_file() and sys.platform == "linux", "no wheel.py, or no Linux")
class Wheels(unittest.TestCase):
    def setUp(self):
        spec = importlib.util.spec_from_file_location("wheel", HERE.parent / "wheel.py")
        self.wheel = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.wheel)

    def test_every_file_is_recorded_as_it_is(self):
        package = {"version": "1.2.3", "license": "MIT OR Apache-2.0"}
        library = b"\0GLIBC_2.17\0GLIBC_2.28\0GLIBC_2.4\0"
        with tempfile.TemporaryDirectory() as folder:
            path = self.wheel.wheel(package, library, pathlib.Path(folder))
            self.assertRegex(path.name, r"^deepfield-1\.2\.3-cp311-abi3-manylinux_2_28_\w+\.whl$")
            first = path.read_bytes()
            self.assertEqual(self.wheel.wheel(package, library, pathlib.Path(folder)).read_bytes(), first)
            with zipfile.ZipFile(path) as archive:
                files = {name: archive.read(name) for name in archive.namelist()}
        about = "deepfield-1.2.3.dist-info"
        rows = list(csv.reader(io.StringIO(files[f"{about}/RECORD"].decode())))
        self.assertEqual(sorted(row[0] for row in rows), sorted(files))
        for name, digest, size in rows:
            if digest:
                found = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest()).rstrip(b"=").decode()
                self.assertEqual((digest, int(size)), (f"sha256={found}", len(files[name])))
        self.assertEqual(files["deepfield/_deepfield.abi3.so"], library)
        for name in ("deepfield/__init__.py", "deepfield/__init__.pyi", "deepfield/py.typed", f"{about}/licenses/LICENSE-MIT"):
            self.assertIn(name, files)

    def test_a_library_that_needs_libpython_is_refused(self):
        with self.assertRaisesRegex(SystemExit, "PYO3_BUILD_EXTENSION_MODULE"):
            self.wheel.platform_tag(b"\0libpython3.11.so.1.0\0GLIBC_2.17\0")


if __name__ == "__main__":
    unittest.main()
