"""Catalogues of objects as tables, their objects in questions, and selections that become files."""

import pathlib
import shutil
import subprocess
import unittest

import numpy as np

import deepfield
from test_deepfield import PROGRAM, WithFolder, particles
from test_tables import has

DATA = pathlib.Path(__file__).resolve().parents[2] / "tests" / "data"


class Catalogues(WithFolder):
    def test_groups_have_kinds_numbers_and_columns_of_their_own(self):
        found = deepfield.catalogue(DATA / "groups.1.hdf5")
        names = ["Group 4", "Group 3", "Group 2", "Subhalo 0", "Subhalo 1", "Group 1", "Group 0"]
        self.assertEqual(list(found["name"]), names)
        self.assertEqual([f"{kind} {number}" for kind, number in zip(found["kind"], found["id"])], names)
        self.assertEqual((found.about["format"], found.about["box_size"]), ("groups", 10.0))
        self.assertEqual((found["radius"][6], np.isnan(found["radius"][0])), (0.25, True))
        self.assertTrue((np.diff(found["mass"]) <= 0).all())
        self.assertEqual({found.units.get(name) for name in ("x", "y", "z", "radius")}, {found.about["length_unit"]})
        some = deepfield.catalogue(DATA / "groups.0.hdf5", ["position", "id"])
        self.assertEqual(some.columns, ["name", "id", "x", "y", "z"])
        np.testing.assert_array_equal(some["y"], found["y"])

    def test_records_in_several_files_are_one_table(self):
        found = deepfield.catalogue(DATA / "hbt.1.hdf5")
        number = np.arange(5)[::-1]
        self.assertEqual(found.columns, ["name", "kind", "id", "x", "y", "z", "radius", "mass", "Nbound"])
        np.testing.assert_array_equal(found["id"], number)
        np.testing.assert_array_equal(found["Nbound"], 100 - number)
        np.testing.assert_array_equal(found["z"], 10.0 - number)
        self.assertEqual((found.units["x"], found.units["mass"], found.units["Nbound"]), ("a Mpc/h", "1e10 Msun/h", ""))

    def rockstar(self):
        path = self.folder / "out_9.list"
        rows = [f"{3 * row} -1 {(1 + row) * 1e12:e} {200 + row} {100 + row} {row} 2 3" for row in range(4)]
        path.write_text("\n".join(["#ID PID Mvir Vmax Rvir X Y Z", *rows, ""]))
        return path

    def test_lists_have_all_numbers(self):
        found = deepfield.catalogue(self.rockstar())
        self.assertEqual(found.columns[-2:], ["PID", "Vmax"])
        self.assertEqual((found["id"].tolist(), found["Vmax"].tolist()), ([9, 6, 3, 0], [203.0, 202.0, 201.0, 200.0]))
        self.assertEqual(deepfield.catalogue(self.rockstar(), "Vmax").columns, ["name", "Vmax"])
        self.refused("field vmax: not there, expected one of .*Vmax", deepfield.catalogue, self.rockstar(), "vmax")
        self.refused("properties: found .* at most 40 bytes", deepfield.catalogue, self.rockstar(), memory=40)
        self.refused("time: found one step", deepfield.catalogue, self.rockstar(), time="last")
        self.refused("nowhere.csv", deepfield.catalogue, self.folder / "nowhere.csv")

    @has("h5py")
    def test_haloes_of_velociraptor_lie_in_several_files(self):
        import h5py

        for part in range(2):
            number = np.arange(3) + 3 * part
            with h5py.File(self.folder / f"halo.properties.{part}", "w") as file:
                file["File_id"], file["Num_of_files"] = np.array([part]), np.array([2])
                file["ID"], file["Structuretype"] = number + 1, 10 * number
                file["Xc"], file["Yc"], file["Zc"] = number + 0.5, 2.0 * number, 10.0 - number
                file["Mass_200crit"], file["R_200crit"] = 9.0 - number, 1.0 + number
        for part in range(2):
            found = deepfield.catalogue(self.folder / f"halo.properties.{part}")
            self.assertEqual((found["id"].tolist(), found["Structuretype"].tolist()), ([1, 2, 3, 4, 5, 6], [0, 10, 20, 30, 40, 50]))
        (self.folder / "halo.properties.0").unlink()
        self.refused("halo.properties.0", deepfield.catalogue, self.folder / "halo.properties.1")

    @has("pandas")
    def test_pandas_has_names(self):
        found = deepfield.catalogue(DATA / "groups.0.hdf5")
        frame = found.to_pandas()
        self.assertEqual(frame["name"].tolist(), list(found["name"]))
        self.assertEqual(frame[frame["kind"] == "Subhalo"]["id"].tolist(), [0, 1])

    @has("pyarrow")
    def test_arrow_has_names(self):
        import pyarrow

        found = deepfield.catalogue(DATA / "groups.0.hdf5")
        self.assertEqual(pyarrow.table(found)["name"].to_pylist(), list(found["name"]))
        texts = deepfield.Table({"a": np.array(["x", "", "long"]), "b": np.array([1, 2, 3], dtype=object)})
        self.assertEqual(pyarrow.table(texts).to_pydict(), {"a": ["x", "", "long"], "b": [1.0, 2.0, 3.0]})


class Objects(WithFolder):
    """A page file of a source that is still there, with three objects in it."""

    def setUp(self):
        super().setUp()
        arrays = particles()
        self.source = self.folder / "box.csv"
        columns = np.column_stack([np.arange(3000) + 7, arrays["positions"], arrays["mass"], arrays["temperature"]])
        names = "id,x [kpc],y [kpc],z [kpc],mass,temperature"
        lines = (",".join([str(int(row[0])), *map(repr, row[1:].tolist())]) for row in columns)
        self.source.write_text("\n".join([names, *lines, ""]))
        self.data = deepfield.build(self.source, self.folder / "box.df")
        self.catalogue = self.folder / "objects.csv"
        self.catalogue.write_text(
            "name,x [kpc],y [kpc],z [kpc],radius [kpc],mass\nSmall,0.2,0.3,0.4,0.1,1\nBig,0.5,0.5,0.5,0.3,9\nBare,0.1,0.1,0.1,,0\n"
        )
        self.big = (0.5, 0.5, 0.5, 0.3)

    def at(self, name):
        return f"{self.catalogue}#{name}"

    def test_an_object_is_its_sphere_in_every_question(self):
        data, big = self.data, self.big
        for at in (self.at(0), self.at("big")):
            self.assertEqual(dict(data.probe(at=at, threads=1)), dict(data.probe(sphere=big, threads=1)))
        found, expected = data.select(at=self.at(0), fields=["id"]), data.select(big, fields=["id"])
        np.testing.assert_array_equal(found["id"], expected["id"])
        self.assertLess(0, len(expected))
        same = lambda ask: np.testing.assert_array_equal(*(ask(exact=True, **of) for of in ({"at": self.at(0)}, {"sphere": big})))
        same(lambda **of: data.profile(shells=5, **of)["count"])
        same(lambda **of: data.histogram("temperature", 5, **of).counts)
        same(lambda **of: data.phase("temperature", "mass", (3, 3), **of).counts)
        bare = data.select(at=self.at("Bare"), radius=0.2)
        self.assertEqual(len(bare), len(data.select((0.1, 0.1, 0.1, 0.2))))

    def test_mistakes_are_told(self):
        probe = self.data.probe
        self.refused("at: found a sphere, too", probe, self.big, at=self.at(0))
        self.refused("radius: found no object", probe, radius=0.1)
        self.refused("radius: found -1", probe, at=self.at(0), radius=-1)
        self.refused("at is .*, expected CATALOGUE#N", probe, at=str(self.catalogue))
        self.refused("at: found 3", probe, at=3)
        self.refused("object #3: not there, expected 0 to 2", probe, at=self.at(3))
        self.refused("object \"Bigger\": not there", probe, at=self.at("Bigger"))
        self.refused("radius of Bare: not there", probe, at=self.at("Bare"))
        self.refused("ids: found a region, too", self.data.select, ids=[7], at=self.at(0))

    def test_selections_become_files(self):
        expected = self.data.select(self.big)
        for name in ("halo.csv", "halo.parquet", "halo.hdf5", "halo.fits", "halo.vtp", "halo.ply"):
            out = self.folder / name
            self.assertEqual(self.data.export(out, at=self.at(0)), len(expected), name)
            again = deepfield.build(out, self.folder / "again.df").select(fields=["x", "temperature"])
            for column in ("x", "temperature"):
                np.testing.assert_array_equal(np.sort(again[column]), np.sort(expected[column]), name)
        ids = self.folder / "halo.ids"
        self.assertEqual(self.data.export(ids, at=self.at(0)), len(expected))
        # What does not expand is physical already.
        self.data.export(self.folder / "physical.csv", self.big, frame="physical")
        self.assertEqual((self.folder / "physical.csv").read_bytes(), (self.folder / "halo.csv").read_bytes())
        if PROGRAM:
            program = self.folder / "program.csv"
            command = [PROGRAM, "select", self.source, "--at", self.at(0), "-o", program]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            self.assertEqual(program.read_bytes(), (self.folder / "halo.csv").read_bytes())
        with self.assertWarnsRegex(deepfield.Note, "1 of 2 ids are not there"):
            self.assertEqual(self.data.export(ids, ids=[7, 1]), 1)
        self.assertEqual(ids.read_text().splitlines()[1:], ["7"])

    def test_what_has_no_source_is_as_the_page_file_has_it(self):
        data = deepfield.build(particles(200), self.folder / "alone.df")
        with self.assertWarnsRegex(deepfield.Note, "values are those of the page file"):
            self.assertEqual(data.export(self.folder / "alone.csv"), 200)
        self.refused("frame: found data that does not say", data.export, self.folder / "none.csv", frame="physical")
        self.refused("arrays|source", data.export, self.folder / "none.ids")
        self.assertFalse((self.folder / "none.csv").exists())

    def test_nothing_that_is_read_is_written_over(self):
        before = {path: path.read_bytes() for path in (self.source, self.catalogue)}
        for path in before:
            self.refused("cannot be written: found a file that is read", self.data.export, path, at=self.at(0))
        self.refused("expected a name that ends in .csv", self.data.export, self.folder / "halo.txt")
        self.refused("found a folder", self.data.export, self.folder)
        self.refused("frame: found 'proper'", self.data.export, self.folder / "halo.csv", frame="proper")
        self.refused("field dust", self.data.export, self.folder / "halo.csv", where={"dust": (0, None)})
        self.assertEqual({path: path.read_bytes() for path in before}, before)
        self.assertEqual(sorted(path.name for path in self.folder.iterdir()), ["box.csv", "box.df", "objects.csv"])

    def test_no_other_file_of_a_catalogue_is_written_over(self):
        for part in range(2):
            shutil.copy(DATA / f"hbt.{part}.hdf5", self.folder)
        other = self.folder / "hbt.1.hdf5"
        at = f"{self.folder / 'hbt.0.hdf5'}#0"
        self.refused("cannot be written: found a file that is read", self.data.export, other, at=at)
        self.assertEqual(other.read_bytes(), (DATA / other.name).read_bytes())


if __name__ == "__main__":
    unittest.main()
