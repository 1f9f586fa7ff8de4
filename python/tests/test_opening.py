"""What is said of data that is opened, and of files that are built; and scenes, which say it of their own."""

import os
import pickle
import struct
import subprocess
import unittest
import unittest.mock
import warnings
import zlib

import numpy as np

import deepfield
from test_deepfield import ABOVE, PROGRAM, WithFolder, particles, write_movie


def png(width, height, color):
    """A picture of one colour (PNG, sections 5 and 11)."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head, rows = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0), (b"\0" + bytes(color) * width) * height
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


class Opening(WithFolder):
    def setUp(self):
        super().setUp()
        cache = str(self.folder / "cache")
        caches = unittest.mock.patch.dict(os.environ, {"XDG_CACHE_HOME": cache, "LOCALAPPDATA": cache})
        caches.start()
        self.addCleanup(caches.stop)

    def test_heights_are_what_is_said_of_them(self):
        slope = self.folder / "slope.npy"
        np.save(slope, np.add.outer(np.arange(6), np.arange(9)).astype(np.uint8))
        self.assertEqual(deepfield.open(slope).kind, "image")
        said = {"kind": "heights", "nodata": 13, "spacing": np.array([2.0, 3.0]), "xy_unit": "m", "height_unit": "m"}
        opened = deepfield.open(slope, **said)
        one = {name: said[name] for name in ("kind", "spacing")}
        in_mapping = deepfield.open({"path": slope, **one}, nodata=13, xy_unit="m", height_unit="m")
        built = deepfield.build(slope, self.folder / "slope.df", **said)
        again = pickle.loads(pickle.dumps(opened))
        for data in (opened, in_mapping, built, again):
            self.assertEqual((data.kind, data.unit), ("heights", "m"))
            # The one sample of 13 was not measured.
            np.testing.assert_allclose(np.ptp(data.bounds, axis=0), (16.0, 15.0, 12.0))
            self.assertEqual(np.isnan(data.heights()).sum(), 1)
        self.assertEqual(again.render(size=(48, 32)).png(), opened.render(size=(48, 32)).png())

    def test_heights_are_compared_with_earlier_ones_under_a_photo(self):
        slope, before, photo = (self.folder / name for name in ("slope.npy", "before.npy", "photo.png"))
        values = np.add.outer(np.arange(6.0), np.arange(9.0))
        np.save(slope, values)
        np.save(before, values - 1.0)
        photo.write_bytes(png(9, 6, (200, 20, 20)))
        self.refused("difference", deepfield.open(slope).render, size=(24, 16), attribute="difference")
        data = deepfield.open(slope, before=before)
        self.assertIn("difference", data.attributes)
        self.assertEqual(data.render(size=(24, 16), attribute="difference").size, (24, 16))
        self.refused("absent.npy", deepfield.open, slope, before=self.folder / "absent.npy")
        over = deepfield.open(slope, texture=photo, texture_at=(0, 0, 8, 5))
        self.assertIn("texture", over.attributes)
        red, green, _ = over.render(size=(24, 16), attribute="texture").rgba[8, 12, :3].astype(int)
        self.assertGreater(red, green + 20)
        # Nothing that it is a picture of is written over.
        self.refused("found a file that is read", data.render(size=(8, 8)).save, before)

    def test_what_is_derived_is_there(self):
        arrays = particles(400)
        source, velocities = self.folder / "box.csv", np.random.default_rng(5).random((400, 3))
        table = np.column_stack([arrays["positions"], velocities])
        np.savetxt(source, table, delimiter=",", header="x,y,z,vx,vy,vz", comments="")
        data = deepfield.open(source, derive=["divergence"])
        self.assertIn("divergence", data.attributes)
        self.assertNotIn("divergence", deepfield.open(source).attributes)
        found = data.histogram("divergence", bins=8, weight="count")
        self.assertEqual(found.counts.sum(), 400)
        self.refused("derive: found an image or a volume|derive: found heights", deepfield.open, self.array(), derive="divergence")

    def array(self):
        cube = self.folder / "cube.npy"
        np.save(cube, np.arange(60, dtype=np.float32).reshape(3, 4, 5))
        return cube

    def test_datasets_lie_where_is_said(self):
        box = self.folder / "box.df"
        data = deepfield.build(particles(300), box)
        both = deepfield.open([box, {"path": box, "offset": (2.0, 0.0, 0.0), "scale": 0.5}])
        self.assertEqual(both.count, 600)
        end = 2.0 + 0.5 * data.bounds[1][0]
        np.testing.assert_allclose(both.bounds[1][0], end)
        np.testing.assert_allclose(pickle.loads(pickle.dumps(both)).bounds, both.bounds)
        np.testing.assert_allclose(deepfield.Scene(both).open().bounds, both.bounds)
        moved = deepfield.open({"path": box, "offset": (2.0, 0.0, 0.0)})
        self.refused("probe: found a dataset that is moved or scaled", moved.probe)
        self.refused("select: found 2 datasets, expected one", both.select)

    def test_mistakes_are_the_programs(self):
        cube = self.array()
        for said, pattern in [
            ({"kind": "hights"}, "kind: unknown variant `hights`, expected one of `heights`"),
            ({"nodata": 0}, "cube.npy: nodata: found no heights, expected some"),
            ({"texture_at": (0, 0, 1, 1)}, "texture_at: found no texture, expected one"),
            ({"derive": "speed"}, "derive: expected all, or some of velocity-dispersion"),
        ]:
            self.refused(pattern, deepfield.open, cube, **said)
        self.refused("ofset: unknown field `ofset`", deepfield.open, {"path": cube, "ofset": (0, 0, 0)})
        self.refused("scale: found -1, expected a positive number", deepfield.open, {"path": cube, "scale": -1})
        self.refused("source: found list, expected paths, or mappings with a path", deepfield.open, [{"offset": (0, 0, 0)}])

    def test_samples_without_a_header_are_built(self):
        raw, out = self.folder / "samples.raw", self.folder / "samples.df"
        values = np.arange(120, dtype=">u2").reshape(2, 3, 4, 5)
        raw.write_bytes(b"header" + values.tobytes())
        built = deepfield.build(raw, out, shape=(4, 3, 2), type="u16", channels=5, skip=6, big_endian=True, spacing=(1, 1, 2))
        self.assertEqual((built.kind, built.shape), ("volume", (4, 3, 2)))
        np.testing.assert_array_equal(built.array(), values)
        self.refused("type: missing", deepfield.build, raw, out, shape=(4, 3))
        self.refused("type: found no shape", deepfield.build, raw, out, type="u16")
        self.refused("type: found \"u12\", expected i8", deepfield.build, raw, out, shape=(4, 3), type="u12")
        self.refused("spacing: found 1, expected 2 positive", deepfield.build, raw, out, shape=(4, 3), type="u16", spacing=[1])
        self.refused("shape: found arrays, expected files", deepfield.build, particles(9), out, shape=(4, 3), type="u16")

    def test_runs_have_the_steps_that_are_asked_for(self):
        movie, out = self.folder / "movie.xyz", self.folder / "run.df"
        write_movie(movie, np.random.default_rng(3).random((60, 3)))
        for said, steps in [
            ({"every": 2}, [0.0, 2.0]),
            ({"times": "5:0.5"}, [5.0, 5.5, 6.0]),
            ({"times": [1.0, 2.0, 4.0], "skip_damaged": True}, [1.0, 2.0, 4.0]),
        ]:
            self.assertEqual(deepfield.build(movie, out, **said).steps.tolist(), steps)
        self.refused("times: found \"soon\", expected times such as", deepfield.build, movie, out, times="soon")
        self.refused("every: found 0, expected a whole number", deepfield.build, movie, out, every=0)
        self.refused("times: found an image or a volume", deepfield.build, self.array(), out, times="steps")

    def test_paths_are_a_mode_of_runs(self):
        movie = self.folder / "movie.xyz"
        write_movie(movie, np.random.default_rng(3).random((60, 3)))
        run = deepfield.build(movie, self.folder / "run.df")
        self.assertIn("paths", run.modes)
        self.assertNotIn("paths", deepfield.build(particles(50), self.folder / "box.df").modes)
        # From where all have come at its end.
        paths = run.render({**ABOVE, "ortho": 6.0}, (48, 32), "paths")
        self.assertGreater(paths.rgba[..., :3].max(), 0)
        np.testing.assert_array_equal(paths.rgba, run.render({**ABOVE, "ortho": 6.0}, (48, 32), "paths", time="last").rgba)


class Scenes(WithFolder):
    def setUp(self):
        super().setUp()
        arrays = particles(400)
        self.families = {"gas": arrays, "dark": {**arrays, "positions": 0.5 * arrays["positions"]}}
        self.data = deepfield.build(self.families, self.folder / "two.df")
        self.said = {"mode": "column-density", "size": (48, 32), "camera": ABOVE}
        self.file = self.folder / "gas.scene.ron"
        # As the window saves that a family is hidden.
        self.scene(families=["gas"]).write(self.file)

    def scene(self, **dataset):
        return deepfield.Scene(datasets=[{"path": "two.df", **dataset}], **self.said)

    def test_a_scene_hides_families_of_its_data(self):
        gas, both = (self.data.render(ABOVE, (48, 32), "column-density", families=names) for names in ("gas", "gas,dark"))
        self.assertFalse(np.array_equal(gas.rgba, both.rgba))
        own = deepfield.open(self.file)
        pictures = [
            self.data.render(scene=self.file),
            own.render(),
            pickle.loads(pickle.dumps(own)).render(),
            deepfield.Scene.read(self.file).render(),
            deepfield.Scene(own, **self.said).render(),
            # Other data shows the same.
            deepfield.build(self.families, self.folder / "other.df").render(scene=self.file),
        ]
        for picture in pictures:
            np.testing.assert_array_equal(picture.rgba, gas.rgba)
        np.testing.assert_array_equal(self.data.render(scene=self.file, families="gas,dark").rgba, both.rgba)
        np.testing.assert_array_equal(own.render(families="gas,dark").rgba, both.rgba)

    @unittest.skipUnless(PROGRAM, "DEEPFIELD_PROGRAM names no program")
    def test_a_scene_is_the_programs_picture(self):
        out = self.folder / "gas.png"
        command = [PROGRAM, "render", str(self.file), "-o", str(out), "--backend", "cpu"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        self.assertEqual(deepfield.open(self.file).render().png(), out.read_bytes())

    def test_what_does_not_apply_is_told(self):
        def told(scene):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                deepfield.build(particles(40), self.folder / "other.df").render(scene=scene)
            return [str(one.message) for one in caught if "datasets: " in str(one.message)]

        moved = self.folder / "moved.scene.ron"
        self.scene(offset=(1.0, 0.0, 0.0), families=["gas"]).write(moved)
        (note,) = told(moved)
        self.assertIn("since other data is drawn: offset", note)
        self.assertEqual(told(self.file), [])
        # Of its own data all of it is drawn.
        box = self.data.render({**ABOVE, "eye": (1.5, 0.5, 9.0), "target": (1.5, 0.5, 0.5)}, scene=moved)
        self.assertLess(np.abs(box.rgba.astype(int) - deepfield.open(self.file).render().rgba).mean(), 0.5)


if __name__ == "__main__":
    unittest.main()
