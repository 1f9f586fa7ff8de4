"""The package `deepfield`, as it is imported: `python -m unittest discover python/tests`.

DEEPFIELD_PROGRAM names the program that pictures and files are compared with; without it these tests are skipped.
"""

import math
import os
import pathlib
import subprocess
import tempfile
import tracemalloc
import unittest
import unittest.mock
import warnings

import numpy as np

import deepfield

PROGRAM = os.environ.get("DEEPFIELD_PROGRAM")
# All of the unit cube, and what reaches out of it.
ABOVE = {"eye": (0.5, 0.5, 9.0), "target": (0.5, 0.5, 0.5), "up": (0.0, 1.0, 0.0), "ortho": 1.5}


def particles(count=3000, seed=7):
    """Particles in a unit cube, of single and double precision, in order and strided."""
    random = np.random.default_rng(seed)
    interleaved = random.random((count, 2))
    return {
        "positions": random.random((count, 3)),
        "mass": (0.5 + interleaved[:, 0]),
        "smoothing_length": (0.02 + 0.06 * interleaved[:, 1]).astype(np.float32),
        "temperature": np.exp(random.normal(8.0, 1.0, count)),
    }


def write_movie(path, places):
    """Three snapshots of particles that go along x, by 1 in each step."""
    frames = []
    for step in range(3):
        rows = (f"H {x + step:.6f} {y:.6f} {z:.6f} {100 + row}" for row, (x, y, z) in enumerate(places))
        frames += [str(len(places)), f"Properties=species:S:1:pos:R:3:id:I:1 Time={step:.1f}", *rows]
    path.write_text("\n".join([*frames, ""]))


class WithFolder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        caught = warnings.catch_warnings()
        caught.__enter__()
        self.addCleanup(caught.__exit__, None, None, None)
        warnings.simplefilter("ignore", deepfield.Note)

    def refused(self, pattern, work, /, *arguments, **settings):
        """A failure is one line that says what was expected."""
        with self.assertRaisesRegex(deepfield.Error, pattern) as caught:
            work(*arguments, **settings)
        self.assertNotIn("\n", str(caught.exception))


class OfArrays(WithFolder):
    def setUp(self):
        super().setUp()
        self.arrays = particles()
        units = {"positions": "kpc", "mass": "Msun", "temperature": "K"}
        self.data = deepfield.build(self.arrays, self.folder / "box.df", units=units)

    def test_a_column_density_holds_the_mass(self):
        mass = self.arrays["mass"].sum()
        picture = self.data.render(ABOVE, (96, 96), "column-density", attribute="temperature")
        column = picture.channels["P"]
        self.assertEqual((column.dtype, column.shape), (np.float32, (96, 96)))
        self.assertTrue(picture.converged)
        found = column.sum(dtype=np.float64) * picture.pixel_area
        self.assertLess(abs(found / mass - 1.0), 1e-3)
        # S is the mean of temperature along the line of sight, weighted with mass.
        hue = np.nansum(column * picture.channels["S"], dtype=np.float64) * picture.pixel_area / mass
        mean = (self.arrays["mass"] * self.arrays["temperature"]).sum() / mass
        self.assertLess(abs(hue / mean - 1.0), 2e-3)
        self.assertEqual(picture.units["S"], "K")
        self.assertIn("kpc", picture.units["P"])
        np.testing.assert_allclose(picture.extent, (-0.75, 0.75, -0.75, 0.75))
        # A colour bar of the hue has hues.
        self.assertGreater(len({tuple(color) for color in picture.about["legend"]["hue"]["colors"]}), 20)
        # The arrays may be gone: an exact picture would ask them again.
        self.refused("arrays", self.data.render, ABOVE, (96, 96), "column-density", exact=True)

    def test_right_is_right_and_row_0_is_at_the_top(self):
        corner = {"positions": np.array([[0.9, 0.8, 0.5], [0.1, 0.1, 0.5]]), "mass": np.array([8.0, 1.0]), "smoothing_length": 0.05}
        picture = deepfield.build(corner, self.folder / "corner.df").render(ABOVE, (60, 60), "column-density")
        row, column = np.unravel_index(np.argmax(picture.channels["P"]), (60, 60))
        left, _, _, upper = picture.extent
        edge = math.sqrt(picture.pixel_area)
        self.assertLess(abs(left + (column + 0.5) * edge - 0.4), 2 * edge)
        self.assertLess(abs(upper - (row + 0.5) * edge - 0.3), 2 * edge)

    def test_what_is_told_of_fields_is_what_numpy_says(self):
        gas = self.data.families["gas"]
        self.assertEqual((self.data.kind, self.data.unit, list(self.data.families)), ("particles", "kpc", ["gas"]))
        self.assertEqual(gas.count, len(self.arrays["mass"]))
        np.testing.assert_allclose(self.data.bounds[0], self.arrays["positions"].min(axis=0))
        np.testing.assert_allclose(self.data.bounds[1], self.arrays["positions"].max(axis=0))
        for name in ("temperature", "mass", "smoothing_length"):
            field, values = gas.fields[name.replace("_", "-")], self.arrays[name]
            np.testing.assert_allclose([field.min, field.max, field.mean], [values.min(), values.max(), values.mean()], rtol=1e-5)
            histogram = field.histogram
            self.assertEqual(histogram.counts.sum(), len(values))
            self.assertEqual(len(histogram.edges), len(histogram.counts) + 1)
        self.assertIn("3 000", repr(self.data))

    def test_a_probe_sums_what_numpy_sums(self):
        center, radius = np.array([0.4, 0.5, 0.6]), 0.3
        inside = np.linalg.norm(self.arrays["positions"] - center, axis=1) <= radius
        found = self.data.probe(sphere=(*center, radius), shells=4)
        (family,) = found["families"]
        doubt = family["uncertain"]
        self.assertLessEqual(abs(found["count"] - int(inside.sum())), doubt["count"])
        self.assertLess(doubt["count"], 30)
        mass = self.arrays["mass"][inside].sum()
        # Masses are coded: of some hundred particles a sum is as near as this.
        self.assertLessEqual(abs(found["mass"] - mass), doubt["mass"] + 1e-2 * mass)
        self.assertEqual(len(found["profile"]["shells"]), 4)
        warm = self.data.probe(where={"temperature": (3000.0, None)}, fields=["temperature"])
        # Values are coded, too: particles near the limit may be on its other side.
        self.assertLessEqual(abs(warm["count"] - int((self.arrays["temperature"] >= 3000.0).sum())), 30)

    def test_pictures_have_colours_and_files(self):
        picture = self.data.render(size=(80, 50), mode="points", radius=3.0, background="transparent")
        self.assertEqual((picture.rgba.dtype, picture.rgba.shape, picture.size), (np.uint8, (50, 80, 4), (80, 50)))
        self.assertLess(picture.rgba[..., 3].min(), 255)
        self.assertIsNone(picture.extent)
        picture.save(self.folder / "points.png")
        content = (self.folder / "points.png").read_bytes()
        self.assertTrue(content.startswith(b"\x89PNG") and content == picture._repr_png_())
        picture.save(self.folder / "points.npz")
        with np.load(self.folder / "points.npz") as channels:
            np.testing.assert_array_equal(channels["P"], picture.channels["P"])
        np.testing.assert_array_equal(np.asarray(picture), picture.rgba)
        # A configuration's text says the same as names do.
        text = '(mode: "points", settings: {"radius": 3.0}, size: (80, 50), background: "transparent")'
        np.testing.assert_array_equal(self.data.render(config=text).rgba, picture.rgba)

    def test_pictures_are_handed_over_without_a_copy(self):
        # What is loaded for the first one is not the picture's.
        self.data.render(ABOVE, (16, 16), "column-density", attribute="temperature").png()
        tracemalloc.start()
        self.addCleanup(tracemalloc.stop)
        picture = self.data.render(ABOVE, (512, 512), "column-density", attribute="temperature")
        arrays = [picture.rgba, *picture.channels.values()]
        _, peak = tracemalloc.get_traced_memory()
        self.assertEqual([array.shape[:2] for array in arrays], [(512, 512)] * 3)
        # NumPy's own memory is traced, what the picture was drawn into is not.
        self.assertLess(peak, picture.rgba.nbytes // 2)
        again = [picture._native.rgba(), *picture._native.channels().values()]
        self.assertTrue(all(np.shares_memory(*pair) for pair in zip(arrays, again, strict=True)))
        # Files have what is written into it, and arrays outlive their picture.
        before = picture.png()
        picture.rgba[...] = 255
        self.assertNotEqual(picture.png(), before)
        picture.save(self.folder / "white.png")
        self.assertEqual((self.folder / "white.png").read_bytes(), picture.png())
        column, mass = picture.channels["P"], picture.channels["P"].sum()
        del picture, arrays, again
        self.assertEqual(column.sum(), mass)

    def test_a_list_is_shown_together_and_a_folder_is_what_lies_in_it(self):
        alone, gas = self.folder / "alone", self.folder / "box.df"
        alone.mkdir()
        others, units = particles(100, 8), {"positions": "kpc", "mass": "Msun", "temperature": "K"}
        stars = deepfield.build(others, alone / "stars.df", family="stars", units=units)
        both = deepfield.open([gas, str(alone / "stars.df")])
        self.assertEqual((both.kind, both.count, both.paths), ("particles", 3100, [str(gas), str(alone / "stars.df")]))
        self.assertEqual({name: family.count for name, family in both.families.items()}, {"gas": 3000, "stars": 100})
        np.testing.assert_allclose(both.bounds[1], np.maximum(self.data.bounds[1], stars.bounds[1]))
        picture = both.render(ABOVE, (96, 96), "column-density")
        mass = self.arrays["mass"].sum() + others["mass"].sum()
        found = picture.channels["P"].sum(dtype=np.float64) * picture.pixel_area
        self.assertLess(abs(found / mass - 1.0), 1e-3)
        self.refused("probe: found 2 datasets, expected one", both.probe)
        self.refused("open: found no path, expected at least one", deepfield.open, [])
        found = deepfield.open(alone)
        self.assertEqual((found.count, found.paths), (100, [str(alone / "stars.df")]))
        deepfield.build(others, alone / "again.df", units=units)
        self.refused("alone: folder: .*stars.df.*expected one source in it", deepfield.open, alone)

    def test_mistakes_are_told(self):
        render = self.data.render
        self.refused("no such|os error", deepfield.open, self.folder / "absent.df")
        self.refused("pionts, expected one of column-density", render, mode="pionts")
        self.refused("points has no setting radios", render, mode="points", radios=3.0)
        self.refused("radius is 99", render, mode="points", radius=99)
        self.refused("size: found 0 x 10", render, size=(0, 10))
        self.refused("size: found 5, expected width and height", render, size=5)
        self.refused("camera: fov: found 'wide', expected a number", render, camera={"fov": "wide"})
        self.refused("absent.ron: ", deepfield.Camera.read, self.folder / "absent.ron")
        self.refused("shells: found 'many', expected a whole number", self.data.profile, (0.5, 0.5, 0.5, 0.2), shells="many")
        self.refused("camera: eye", render, camera={"eye": (0.0, 1.0)})
        self.refused("fov and ortho", render, camera={"fov": 20, "ortho": 1})
        self.refused("expected a run", render, time=3.0)
        self.refused("config:1:", render, config="(moed: 3)")
        self.refused("memory: found 'much'", render, memory="much")
        self.refused("a page file of particles, expected a source", deepfield.build, self.folder / "box.df", self.folder / "b.df")
        arrays, out = self.arrays, self.folder / "wrong.df"
        for pattern, wrong in [
            ("positions: missing", {"mass": arrays["mass"]}),
            (r"expected \(n, 3\)", {**arrays, "positions": arrays["positions"][:, :2]}),
            ("found 2999 particles, expected 3000", {**arrays, "mass": arrays["mass"][1:]}),
            ("expected numbers", {**arrays, "name": np.array(["a"] * 3000)}),
            ("found mass twice", {**arrays, "masses": arrays["mass"]}),
            ("no particles", {"positions": np.empty((0, 3))}),
        ]:
            self.refused(pattern, deepfield.build, wrong, out)
        self.refused("expected kpc|expected Mpc", deepfield.build, arrays, out, units={"positions": "Mpc", "smoothing_length": "kpc"})
        self.refused("family Gas", deepfield.build, arrays, out, family="Gas")
        self.assertFalse(out.exists())

    def test_threads_change_nothing_and_their_number_is_checked(self):
        alone = deepfield.build(self.arrays, self.folder / "alone.df", threads=1)
        deepfield.build(self.arrays, self.folder / "three.df", threads=3)
        self.assertEqual((self.folder / "alone.df").read_bytes(), (self.folder / "three.df").read_bytes())
        np.testing.assert_array_equal(alone.render(ABOVE, (40, 40), threads=1).rgba, alone.render(ABOVE, (40, 40)).rgba)
        sphere = (0.5, 0.5, 0.5, 0.3)
        self.assertEqual(*(alone.probe(sphere, threads=threads)["count"] for threads in (1, None)))
        one, all_threads = (alone.select(sphere, fields=["position"], threads=threads) for threads in (1, None))
        for column in one:
            np.testing.assert_array_equal(one[column], all_threads[column])
        for wrong in (0, 1025, 1.5, True):
            for work in (alone.render, alone.probe, alone.select):
                self.refused("threads: found", work, threads=wrong)
            self.refused("threads: found", deepfield.build, self.arrays, self.folder / "no.df", threads=wrong)
            self.refused("threads: found", deepfield.open, self.folder / "alone.df", threads=wrong)

    def test_builds_take_what_the_program_takes_and_refuse_it_in_its_words(self):
        moving = {**self.arrays, "velocities": np.random.default_rng(8).normal(size=(3000, 3))}
        del moving["smoothing_length"]
        near, far = (deepfield.build(moving, self.folder / f"{k}.df", smoothing=f"knn:{k}") for k in (8, 64))
        means = [data.families["gas"].fields["smoothing-length"].mean for data in (near, far)]
        # Twice as far for eight times as many.
        self.assertTrue(1.7 < means[1] / means[0] < 2.4, means)
        named = {"attributes": ["temperature"], "derive": ["divergence", "vorticity"]}
        data = deepfield.build(moving, self.folder / "both.df", hierarchy="octree,pca", **named)
        self.assertTrue({"divergence", "vorticity", "temperature"} <= set(data.families["gas"].fields))
        refused = lambda pattern, **settings: self.refused(pattern, deepfield.build, moving, self.folder / "no.df", **settings)
        refused('derive: expected all, or some of .*; found "curl"', derive="curl")
        refused('smoothing: found "near", expected auto, field:NAME or knn:K', smoothing="near")
        refused("expected a number of neighbours from 1 to 4096", smoothing="knn:0")
        refused('hierarchy: "tree": expected octree', hierarchy="tree")
        refused("hierarchy wavelet: found particles, expected an image or a volume", hierarchy="wavelet")
        self.assertFalse((self.folder / "no.df").exists())

    def test_a_folder_of_numbered_parts_is_one_table(self):
        parts = self.folder / "parts"
        parts.mkdir()
        for number in range(3):
            rows = np.random.default_rng(number).random((40, 3))
            np.savetxt(parts / f"part_{number}.csv", rows, delimiter=",", header="x,y,z", comments="")
        self.assertEqual(deepfield.build(parts, self.folder / "parts.df").count, 120)
        cache = self.folder / "cache"
        with unittest.mock.patch.dict(os.environ, {"XDG_CACHE_HOME": str(cache), "LOCALAPPDATA": str(cache)}):
            data = deepfield.open(parts, threads=1)
            self.assertEqual((data.count, data.paths), (120, [str(parts)]))
            self.assertEqual(data.render(size=(20, 10), mode="points").size, (20, 10))

    def test_several_families_and_units_of_arrays(self):
        class Quantity(np.ndarray):
            units = "Mpc"

        class OfAstropy(np.ndarray):
            unit = "Gyr"

        random = np.random.default_rng(5)
        stars = {"positions": random.random((50, 3)).view(Quantity), "mass": 2, "velocities": random.random((50, 3))}
        stars["age"] = np.arange(50.0).view(OfAstropy)
        dark = {"positions": np.asfortranarray(random.random((70, 3))), "mass": np.full(70, 3, dtype=np.int32)}
        data = deepfield.build({"stars": stars, "dark": dark}, self.folder / "two.df")
        self.assertEqual({name: family.count for name, family in data.families.items()}, {"dark": 70, "stars": 50})
        self.assertEqual((data.unit, data.families["stars"].fields["age"].unit), ("Mpc", "Gyr"))
        speed = np.linalg.norm(stars["velocities"], axis=1)
        field = data.families["stars"].fields["speed"]
        np.testing.assert_allclose([field.min, field.max], [speed.min(), speed.max()], rtol=1e-6)
        self.assertAlmostEqual(data.families["stars"].mass + data.families["dark"].mass, 2 * 50 + 3 * 70, places=3)


class OfRuns(WithFolder):
    def setUp(self):
        super().setUp()
        self.places = particles(60)["positions"]
        movie = self.folder / "movie.xyz"
        write_movie(movie, self.places)
        self.run_of = deepfield.build(movie, self.folder / "run.df")

    def test_a_picture_is_that_of_its_time(self):
        self.assertEqual((self.run_of.kind, self.run_of.steps.tolist()), ("run", [0.0, 1.0, 2.0]))
        camera = {"eye": (1.5, 0.5, 9.0), "target": (1.5, 0.5, 0.5), "up": (0.0, 1.0, 0.0), "ortho": 6.0}
        for time, moved in [(None, 0.0), (0.5, 0.5), ("step:1", 1.0), (1.25, 1.25), ("last", 2.0)]:
            picture = self.run_of.render(camera, (64, 64), "column-density", time=time)
            columns = picture.channels["P"].sum(axis=0, dtype=np.float64)
            x = 1.5 + picture.extent[0] + (np.arange(64) + 0.5) * math.sqrt(picture.pixel_area)
            # What particles weigh is the same for all.
            self.assertLess(abs(np.average(x, weights=columns) - self.places[:, 0].mean() - moved), 0.05, time)
        self.refused("--time 5: ", self.run_of.render, camera, (64, 64), time=5)
        self.refused("expected a time", self.run_of.render, camera, (64, 64), time="soon")

    def test_tracks_have_a_row_at_each_end(self):
        found = self.run_of.tracks(ids=[103, 107])
        self.assertEqual((len(found), sorted(set(found["id"].tolist()))), (8, [103, 107]))
        for row in (3, 7):
            own = np.sort(found["x"][found["id"] == 100 + row])
            np.testing.assert_allclose(own, self.places[row, 0] + [0.0, 1.0, 1.0, 2.0], atol=0.02)
        self.assertEqual(len(self.run_of.tracks(ids=[103], end=1.0)), 2)
        self.assertEqual(len(self.run_of.tracks()), 4 * 60)


@unittest.skipUnless(PROGRAM, "DEEPFIELD_PROGRAM names no program")
class LikeTheProgram(WithFolder):
    def program(self, *arguments):
        subprocess.run([PROGRAM, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)

    def setUp(self):
        super().setUp()
        arrays = particles(2000)
        self.source = self.folder / "box.csv"
        table = np.column_stack([arrays["positions"], arrays["mass"], arrays["smoothing_length"], arrays["temperature"]])
        header = "x,y,z,mass,smoothing_length,temperature"
        np.savetxt(self.source, table, delimiter=",", header=header, comments="")

    def test_files_and_pictures_are_the_same_byte_for_byte(self):
        own, other = self.folder / "own.df", self.folder / "other.df"
        data = deepfield.build(self.source, own)
        self.program("build", self.source, "-o", other)
        self.assertEqual(own.read_bytes(), other.read_bytes())
        camera = ["--eye", "0.5,0.5,9", "--target", "0.5,0.5,0.5", "--up", "0,1,0", "--ortho", "1.5"]
        for mode, settings in [("column-density", {}), ("points", {"radius": 4.0}), ("density-squared", {"presence": 100})]:
            file = self.folder / f"{mode}.png"
            said = [text for name, value in settings.items() for text in ("--set", f"{name}={value}")]
            self.program("render", own, "-o", file, "--backend", "cpu", "--size", "120x80", "--mode", mode, *camera, *said)
            self.assertEqual(data.render(ABOVE, (120, 80), mode, **settings).png(), file.read_bytes(), mode)

    def test_exact_pictures_ask_the_source(self):
        data = deepfield.build(self.source, self.folder / "box.df")
        raw = self.folder / "raw.npy"
        camera = ["--eye", "0.5,0.5,9", "--target", "0.5,0.5,0.5", "--up", "0,1,0", "--ortho", "1.5"]
        self.program("render", self.source, "-o", self.folder / "a.png", "--raw", raw, "--backend", "cpu", "--size", "64x64",
                     "--mode", "column-density", "--exact", *camera)
        found = data.render(ABOVE, (64, 64), "column-density", exact=True).channels["P"]
        np.testing.assert_array_equal(found, np.load(raw))


if __name__ == "__main__":
    unittest.main()
