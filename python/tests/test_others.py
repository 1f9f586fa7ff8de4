"""Objects of pynbody, yt and swiftsimio, and the window: what is built of them, and what the program is asked for."""

import importlib.util
import os
import pathlib
import shutil
import sys
import unittest
import unittest.mock

import numpy as np

import deepfield
from test_deepfield import WithFolder, particles

DATA = pathlib.Path(__file__).resolve().parents[2] / "tests" / "data"


def reads_data(package):
    """Of tests in which a package reads files of ``tests/data``."""
    return unittest.skipUnless(importlib.util.find_spec(package) and DATA.is_dir(), f"{package} is not installed")


class Quantity(np.ndarray):
    """An array with a unit, as the three packages have them."""

    units = ""
    comoving = False

    @staticmethod
    def of(values, units, comoving=False):
        made = np.asarray(values).view(Quantity)
        made.units, made.comoving = units, comoving
        return made

    def __array_finalize__(self, other):
        self.units, self.comoving = getattr(other, "units", ""), getattr(other, "comoving", False)


def of_package(name, bases=(), **members):
    """An object of a class that says that it is of a package."""
    return type(members.pop("kind", "Thing"), bases, {"__module__": f"{name}.inside", **members})()


def snapshot(kind, arrays):
    """As pynbody's: families of arrays, of which some can be worked out."""

    class Part(dict):
        def __getitem__(self, name):
            assert name in self, f"{name} would be worked out"
            return super().__getitem__(name)

        def loadable_keys(self):
            return list(self)

    family = type("Family", (), {"name": "dm"})()
    members = {"kind": kind, "properties": {"a": 0.5}, "families": lambda self: [family], "__getitem__": lambda self, family: Part(arrays)}
    return of_package("pynbody", ancestor=property(lambda self: self), **members)


class OfOthers(WithFolder):
    def setUp(self):
        super().setUp()
        self.arrays = particles(500)
        self.out = self.folder / "box.df"

    def same(self, data, family, unit, mass_unit, support=1.0):
        """All of the particles are there, with units and smoothing lengths as deepfield means them."""
        found = data.families[family]
        self.assertEqual((found.count, data.unit, data.mass_unit), (500, unit, mass_unit))
        self.assertAlmostEqual(found.mass, self.arrays["mass"].sum(), delta=1e-4 * found.mass)
        np.testing.assert_allclose(found.bounds[1], self.arrays["positions"].max(axis=0), rtol=1e-6)
        lengths = found.fields["smoothing-length"]
        np.testing.assert_allclose(lengths.mean, support * self.arrays["smoothing_length"].mean(), rtol=1e-5)

    def test_a_snapshot_of_pynbody(self):
        arrays = self.arrays
        own = {
            "pos": Quantity.of(arrays["positions"], "kpc a h**-1"),
            "mass": Quantity.of(arrays["mass"], "1.00e+10 Msol h**-1"),
            "smooth": arrays["smoothing_length"],
            "temp": Quantity.of(arrays["temperature"], "K"),
            "vel": Quantity.of(np.ones((500, 3)), "km s**-1 a**1/2"),
        }
        data = deepfield.build(snapshot("GadgetHDFSnap", own), self.out)
        self.same(data, "dark", "a kpc/h", "1e10 Msun/h")
        self.assertEqual(data.families["dark"].fields["speed"].unit, "a^0.5 km/s")
        self.assertEqual((data.redshift, data.families["dark"].fields["temperature"].unit), (1.0, "K"))
        # Its text has three digits of a number.
        rounded = type("Unit", (str,), {"_scale": 3.085678e24})("3.09e+24 cm a h**-1")
        alone = type("Unit", (str,), {"_scale": 1.0})("1.00e+00")
        exact = {**own, "pos": Quantity.of(arrays["positions"], rounded), "temp": Quantity.of(arrays["temperature"], alone)}
        data = deepfield.build(snapshot("GadgetHDFSnap", exact), self.out)
        self.same(data, "dark", "a 3.085678e24 cm/h", "1e10 Msun/h")
        self.assertEqual(data.families["dark"].fields["temperature"].unit, "")
        self.same(deepfield.build(snapshot("TipsySnap", own), self.out, attributes=["temp"]), "dark", "a kpc/h", "1e10 Msun/h", 2.0)
        self.refused("attributes: found nothing-of-it", deepfield.build, snapshot("TipsySnap", own), self.out, attributes=["nothing-of-it"])
        self.refused("found no particles", deepfield.build, snapshot("TipsySnap", own), self.out, families=["stars"])

    def test_a_data_set_of_swiftsimio(self):
        arrays = self.arrays
        names = {"coordinates": "positions", "masses": "mass", "smoothing_lengths": "smoothing_length", "temperatures": "temperature"}
        units = {"coordinates": ("Mpc", True), "masses": ("Msun", False), "smoothing_lengths": ("Mpc", True), "temperatures": ("K", False)}
        gas = type("Gas", (), {name: Quantity.of(arrays[own], *units[name]) for name, own in names.items()})()
        about = type("About", (), {
            "present_group_names": ["gas"], "gas_properties": type("Fields", (), {"field_names": list(names)})(),
            "hydro_scheme": {"Kernel function": b"Quartic spline (M5)"}, "boxsize": np.array([1.0, 2.0, 1.0]), "redshift": [2.0],
        })()  # fmt: skip
        data = deepfield.build(of_package("swiftsimio", metadata=about, gas=gas), self.out)
        self.same(data, "gas", "a Mpc", "Msun", 2.018932)
        self.assertEqual((data.redshift, data.box_size), (2.0, None))

    def test_a_data_set_of_yt(self):
        fields = {
            ("PartType4", "particle_position"): Quantity.of(self.arrays["positions"], "kpc"),
            ("PartType4", "particle_mass"): Quantity.of(self.arrays["mass"], "Msun"),
            ("PartType4", "smoothing_length"): Quantity.of(self.arrays["smoothing_length"], "kpc"),
        }
        edges = {"domain_width": Quantity.of([2.0] * 3, "kpc"), "domain_left_edge": Quantity.of([0.0] * 3, "kpc")}
        members = {"field_list": list(fields), "derived_field_list": [], "periodicity": (True,) * 3, "particle_types_raw": ("PartType4",), **edges}
        data = deepfield.build(of_package("yt", all_data=lambda self: fields, **members), self.out)
        self.same(data, "stars", "kpc", "Msun")
        self.assertEqual(data.box_size, 2.0)

    @reads_data("pynbody")
    def test_pynbody_reads_what_deepfield_reads(self):
        import pynbody  # type: ignore

        # It takes lengths of such files for Mpc/h.
        gas = self.agree(pynbody.load(str(DATA / "gizmo.hdf5")), DATA / "gizmo.hdf5", "a Mpc/h", "1e10 Msun/h").families["gas"]
        self.assertEqual(gas.fields["speed"].unit, "a^0.5 km/s")

    @reads_data("swiftsimio")
    def test_swiftsimio_reads_what_deepfield_reads(self):
        import swiftsimio  # type: ignore

        self.agree(swiftsimio.load(DATA / "swift.hdf5"), DATA / "swift.hdf5", "a Mpc", "Msun", masses=1e10)

    @reads_data("yt")
    def test_yt_reads_what_deepfield_reads(self):
        import yt  # type: ignore

        yt.set_log_level(50)
        # In the second, kpc/h at a redshift of 1, families have names of Gadget's own.
        for name, lengths, masses, redshift in [
            ("gas_sphere_collapse_025.hdf5", 1.0, 1e10, None), ("others/pynbody-gadget.dat", 0.5 / 0.7, 1e10 / 0.7, 1.0),
        ]:  # fmt: skip
            with self.subTest(name):
                # It leaves an index beside a file.
                path = pathlib.Path(shutil.copy(DATA / name, self.folder))
                data = self.agree(yt.load(path), path, "kpc", "Msun", lengths, masses)
                self.assertEqual(data.redshift, redshift)

    def agree(self, theirs, path, unit, mass_unit, lengths=1.0, masses=1.0):
        """Of what a package has opened the same is built as of the file, in its units; the data set."""
        built, own = deepfield.build(theirs, self.out), deepfield.build(path, self.folder / "own.df")
        self.assertEqual((set(built.families), built.unit, built.mass_unit), (set(own.families), unit, mass_unit))
        for name, family in own.families.items():
            found = built.families[name]
            self.assertEqual(found.count, family.count)
            np.testing.assert_allclose(found.bounds, lengths * np.asarray(family.bounds), rtol=1e-6)
            np.testing.assert_allclose(found.mass, masses * family.mass, rtol=1e-6)
            mean = lengths * family.fields["smoothing-length"].mean
            np.testing.assert_allclose(found.fields["smoothing-length"].mean, mean, rtol=1e-5)
        return built


@unittest.skipIf(sys.platform == "win32", "the program is a script here")
class Windows(WithFolder):
    def test_a_window_is_asked_for_with_a_scene(self):
        data = deepfield.build(particles(200), self.folder / "box.df")
        program, said = self.folder / "deepfield", self.folder / "said"
        program.write_text(f'#!/bin/sh\necho "$1" > {said}\ncat "$2" >> {said}\n')
        program.chmod(0o755)
        with unittest.mock.patch.dict(os.environ, {"DISPLAY": ":99", "DEEPFIELD_PROGRAM": str(program)}):
            process = data.view(mode="points", settings={"radius": 3.0})
            self.assertEqual(process.wait(20), 0)
            self.refused("pionts, expected one of", data.view, mode="pionts")
            os.environ["DEEPFIELD_PROGRAM"] = str(self.folder / "absent")
            self.refused("absent: ", data.view)
            if sys.platform.startswith("linux"):
                del os.environ["DISPLAY"]
                os.environ.pop("WAYLAND_DISPLAY", None)
                self.refused("view: display: found none", data.view)
        command, _, scene = said.read_text().partition("\n")
        self.assertEqual(command, "view")
        self.assertEqual(deepfield.Scene.from_ron(scene), deepfield.Scene(data, mode="points", settings={"radius": 3.0}))

    def test_scenes_name_files_from_the_root_on_and_urls_as_they_are(self):
        scene = deepfield.Scene(["box.df", "https://example.org/a.df"])
        self.assertEqual([dataset["path"] for dataset in scene.datasets], [os.path.abspath("box.df"), "https://example.org/a.df"])


if __name__ == "__main__":
    unittest.main()
