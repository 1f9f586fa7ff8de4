"""What is written to files: as a whole or not at all, and over nothing that was read."""

import os
import pathlib
import unittest
import unittest.mock

import numpy as np

import deepfield
from test_deepfield import ABOVE, WithFolder, particles


class Written(WithFolder):
    def test_texts_are_written_over_texts_alone(self):
        box, camera = self.folder / "box.df", deepfield.Camera(eye=(0.0, 0.0, 9.0))
        data = deepfield.build(particles(200), box)
        scene = deepfield.Scene(data, mode="points")
        colors = deepfield.TransferFunction(color_map="viridis")
        before, table = box.read_bytes(), self.folder / "table.csv"
        table.write_text("x,y,z\n1,2,3\n")
        for text in (camera, scene, colors):
            for path in (box, table):
                self.refused("cannot be written: found a file that is no text in RON", text.write, path)
            self.refused("absent.*: cannot be written: ", text.write, self.folder / "absent" / "x.ron")
        self.assertEqual((box.read_bytes(), table.read_text()), (before, "x,y,z\n1,2,3\n"))
        own, link = self.folder / "with blanks ä.ron", self.folder / "link.ron"
        scene.write(own)
        link.symlink_to(own)
        camera.write(link)
        self.assertEqual((deepfield.Camera.read(own), link.is_symlink()), (camera, True))

    def test_scenes_that_are_written_elsewhere_find_their_files(self):
        here, there = self.folder / "here", self.folder / "there"
        here.mkdir()
        there.mkdir()
        data = deepfield.build(particles(200), here / "box.df")
        own = here / "own.scene.ron"
        own.write_text('// mine\n(version: 2, datasets: [(path: "box.df")], mode: "points", labels: "names.csv")\n')
        scene = deepfield.Scene.read(own)
        scene.write(here / "again.scene.ron")
        self.assertEqual((here / "again.scene.ron").read_text(), own.read_text())
        scene.write(there / "other.scene.ron")
        for moved in (deepfield.Scene.read(there / "other.scene.ron"), scene.replace(size=(30, 20))):
            self.assertEqual([moved.datasets[0]["path"], moved.labels], [str(here / "box.df"), str(here / "names.csv")])
            self.assertEqual(moved.mode, "points")
        # Those that have no file of their own are from where they are.
        self.assertEqual(deepfield.Scene.from_ron(own.read_text()).replace(mode="volume").datasets[0]["path"], "box.df")
        self.assertEqual(data.render(scene=scene.replace(labels=None, size=(30, 20))).size, (30, 20))

    def test_a_path_may_begin_at_home(self):
        home = str(self.folder)
        with unittest.mock.patch.dict(os.environ, {"HOME": home, "USERPROFILE": home}):
            data = deepfield.build(particles(200), "~/box.df")
            self.assertEqual((deepfield.open("~/box.df").count, data.paths), (200, [str(self.folder / "box.df")]))
            picture = data.render(ABOVE, (20, 10), "points")
            picture.save("~/box.png")
            picture.save(pathlib.Path("~/box.npz"))
            deepfield.Camera(eye=(0.0, 0.0, 9.0)).write("~/camera.ron")
            self.assertEqual(deepfield.Camera.read("~/camera.ron").eye, (0.0, 0.0, 9.0))
            scene = deepfield.Scene("~/box.df", mode="points")
            scene.write("~/own.scene.ron")
            self.assertEqual(deepfield.Scene.read("~/own.scene.ron").datasets[0]["path"], str(self.folder / "box.df"))
            self.refused("cannot be written: found a file that is read", picture.save, "~/box.df")
        self.assertEqual({path.name for path in self.folder.iterdir()}, {"box.df", "box.png", "box.npz", "camera.ron", "own.scene.ron"})

    def test_what_is_no_text_is_told(self):
        deepfield.build(particles(200), self.folder / "box.df")
        for read in (deepfield.Camera.read, deepfield.Scene.read, deepfield.Tour.read, deepfield.TransferFunction.read):
            self.refused("box.df: found bytes that are no text", read, self.folder / "box.df")

    def test_a_picture_is_not_written_over_what_it_is_of(self):
        photo = self.folder / "photo.png"
        deepfield.build(particles(200), self.folder / "box.df").render(ABOVE, (40, 30)).save(photo)
        before = photo.read_bytes()
        image = deepfield.open(photo)
        # Of the image, and of a file that was built of it.
        for data in (image, deepfield.build(photo, self.folder / "photo.df")):
            picture = data.render(size=(20, 15))
            for name in (photo, self.folder / "." / "photo.png"):
                self.refused("photo.png: cannot be written: found a file that is read", picture.save, name)
            picture.save(self.folder / "other.PNG")
        self.assertEqual(photo.read_bytes(), before)

    def test_a_picture_is_not_written_over_a_slice(self):
        slices = self.folder / "slices"
        slices.mkdir()
        picture = deepfield.build(particles(200), self.folder / "box.df").render(ABOVE, (20, 16))
        for number in range(4):
            picture.save(slices / f"slice_{number}.png")
        volume = deepfield.open(slices)
        self.assertEqual(volume.kind, "volume")
        drawn = volume.render(size=(20, 15))
        self.refused("slice_2.png: cannot be written: found a file that is read", drawn.save, slices / "slice_2.png")
        drawn.save(slices.parent / "slice_2.png")

    def test_a_build_is_not_written_over_what_it_is_of(self):
        tables = self.folder / "tables"
        tables.mkdir()
        parts = [tables / f"part_{number}.csv" for number in range(2)]
        for number, part in enumerate(parts):
            part.write_text(f"x,y,z\n{number},0,0\n{number},1,1\n")
        before = [part.read_bytes() for part in parts]
        link = self.folder / "link.csv"
        link.symlink_to(parts[0])
        for source, out in [(parts[0], parts[0]), (parts[0], link), (tables, parts[1]), (tables / "*.csv", parts[1]), (parts, parts[0])]:
            self.refused(f"{out.name}: cannot be written: found a file that is read", deepfield.build, source, out)
        numbers = self.folder / "places.npy"
        np.save(numbers, np.random.default_rng(1).random((50, 3)))
        mapped = np.load(numbers, mmap_mode="r")
        whole = self.folder / "whole.npy"
        np.save(whole, np.arange(150).reshape(50, 3))
        # These are copied as they become floats.
        copied = np.load(whole, mmap_mode="r")
        for arrays, out in [({"positions": mapped}, numbers), ({"gas": {"positions": mapped[::2]}}, numbers), ({"positions": copied}, whole)]:
            self.refused(f"{out.name}: cannot be written: found a file that is read", deepfield.build, arrays, out)
        self.assertEqual([part.read_bytes() for part in parts], before)
        np.testing.assert_array_equal(np.load(numbers), mapped)
        self.assertEqual(deepfield.build(parts[0], self.folder / "part.df").count, 2)

    def test_frames_are_not_written_over_what_they_are_of(self):
        frames = self.folder / "frames"
        frames.mkdir()
        photo = frames / "frame-00001.png"
        deepfield.build(particles(200), self.folder / "box.df").render(ABOVE, (20, 16)).save(photo)
        before, tour = photo.read_bytes(), deepfield.Tour.around(2.0)
        self.refused("frame-00001.png: cannot be written: found a file that is read", tour.render, deepfield.open(photo), frames, (32, 24), 1)
        self.assertEqual(photo.read_bytes(), before)

    def test_numbers_that_could_not_be_written_leave_those_before(self):
        picture = deepfield.build(particles(200), self.folder / "box.df").render(ABOVE, (40, 30))
        numbers = self.folder / "numbers.npz"
        picture.save(numbers)
        before = numbers.read_bytes()

        def full(file, **channels):
            file.write(b"half")
            raise OSError(28, "No space left on device")

        with unittest.mock.patch.object(np, "savez", full):
            self.refused("numbers.npz: cannot be written: No space left", picture.save, numbers)
        self.assertEqual(numbers.read_bytes(), before)
        self.assertEqual([path.name for path in self.folder.glob(".deepfield-*")], [])
        np.testing.assert_array_equal(np.load(numbers)["P"], picture.channels["P"])
