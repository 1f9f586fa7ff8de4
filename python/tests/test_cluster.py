"""Builds cut into tasks: here, and by workers of Dask where that is installed. The file is that of one process, whatever happens to them."""

import importlib.util
import logging
import os
import signal
import sys
import unittest
import unittest.mock

import numpy as np

import deepfield
import deepfield.cluster
from test_deepfield import WithFolder, particles


class Enough(Exception):
    pass


class OfTasks(WithFolder):
    def setUp(self):
        super().setUp()
        arrays = particles(4000)
        self.source, self.out, self.job = (self.folder / name for name in ("box.csv", "box.df", "box.df.job"))
        table = np.column_stack([arrays["positions"], arrays["mass"], arrays["temperature"]])
        np.savetxt(self.source, table, delimiter=",", header="x,y,z,mass,temperature", comments="")

    def build(self, client=None, **more):
        return deepfield.cluster.build(self.source, self.out, client, **{"smoothing": "knn:16", "tasks": 3, **more})

    def done(self):
        """How many tasks are done of each stage, and of how many."""
        return [(stage["name"], stage["done"], stage["tasks"]) for stage in deepfield.cluster.status(self.job)["stages"]]

    def after(self, tasks, act):
        """Progress that acts when so many tasks are done."""

        def tell(*_):
            if (self.job / "job.json").exists() and sum(done for _, done, _ in self.done()) >= tasks:
                act()

        return tell

    def enough(self, tasks):
        """Progress that ends a build when so many tasks are done."""

        def act():
            raise Enough

        return self.after(tasks, act)

    def is_as_of_one_process(self, data):
        self.assertEqual(data.count, 4000)
        deepfield.build(self.source, self.folder / "alone.df", smoothing="knn:16")
        self.assertEqual(self.out.read_bytes(), (self.folder / "alone.df").read_bytes())
        self.is_clean("alone.df", "box.csv", "box.df")

    def is_clean(self, *more):
        self.assertEqual(sorted(path.name for path in self.folder.iterdir()), sorted(more))


class Here(OfTasks):
    def test_a_build_goes_on_from_where_one_was_and_what_is_run_again_does_no_harm(self):
        with self.assertRaises(Enough):
            self.build(progress=self.enough(4))
        self.is_clean("box.csv")
        with self.assertRaises(Enough):
            self.build(progress=self.enough(4), keep=True)
        done = self.done()
        self.assertEqual(sum(count for _, count, _ in done), 4)
        # The job is that of these options alone.
        self.refused("box.df.job", self.build, smoothing="knn:20")
        deepfield.cluster.run(self.job, done[0][0], 0, threads=1)
        self.assertEqual(self.done(), done)
        self.assertFalse(deepfield.cluster.status(self.job)["finished"])
        reached = []
        self.is_as_of_one_process(self.build(memory="1GiB", threads=1, progress=lambda *what: reached.append(what)))
        self.assertTrue({(name, tasks, tasks) for name, _, tasks in done} <= set(reached), reached)

    def test_tasks_that_others_start_build_the_same_file(self):
        options = {"smoothing": "knn:16", "tasks": 3}
        planned = deepfield.cluster.plan(self.source, self.out, **options)
        self.assertEqual((planned["job"], planned["finished"]), (str(self.job), False))
        self.assertEqual(planned, deepfield.cluster.status(self.job))
        for stage in planned["stages"]:
            # In any order, and one of them twice.
            for task in [0, *reversed(range(stage["tasks"]))]:
                deepfield.cluster.run(self.job, stage["name"], task, memory="1GiB", threads=1)
        # The plan is there, and so is what was done.
        self.assertTrue(deepfield.cluster.plan(self.source, self.out, **options)["finished"])
        self.refused("box.df.job", deepfield.cluster.plan, self.source, self.out, tasks=4)
        stages = [stage["name"] for stage in planned["stages"]]
        self.refused("absent", deepfield.cluster.run, self.job, "absent", 0)
        self.refused("1000000", deepfield.cluster.run, self.job, stages[0], 1_000_000)
        self.refused("task: found -1, expected a whole number from 0", deepfield.cluster.run, self.job, stages[0], -1)
        deepfield.cluster.cancel(self.job)
        self.refused("box.df.job", deepfield.cluster.cancel, self.job)
        self.refused("box.df.job", deepfield.cluster.run, self.job, stages[0], 0)
        self.is_as_of_one_process(deepfield.open(self.out))

    def test_a_run_is_that_of_one_process(self):
        movie, out, alone = (self.folder / name for name in ("movie.xyz", "movie.df", "alone.df"))
        frames = []
        for step in range(3):
            rows = (f"H {x:.6f} {y:.6f} {z:.6f}" for x, y, z in particles(200)["positions"] + 0.1 * step)
            frames += ["200", f"Properties=species:S:1:pos:R:3 Time={step / 2}", *rows]
        movie.write_text("\n".join([*frames, ""]))
        self.refused("tasks: found 3, expected none: a run of 3 steps", deepfield.cluster.build, movie, out, tasks=3)
        reached = []
        deepfield.cluster.build(movie, out, progress=lambda *what: reached.append(what))
        self.assertTrue({("steps", 3, 3), ("run", 1, 1)} <= set(reached), reached)
        deepfield.build(movie, alone)
        self.assertEqual(out.read_bytes(), alone.read_bytes())
        self.is_clean("alone.df", "box.csv", "movie.df", "movie.xyz")

    def test_too_many_tasks_are_told(self):
        # Steps of a run cannot be fewer.
        for name, advice in [("survey", ", with a smaller tasks="), ("steps", "")]:
            workers = deepfield.cluster._Workers(None, "box.job", (None, None), None, {})
            with self.assertRaises(deepfield.Error) as told:
                workers.run([{"name": name, "tasks": 50_000, "after": []}])
            self.assertEqual(str(told.exception), f"box.job: tasks: found 50000, expected less than 50000{advice}")

    def test_mistakes_are_told_and_leave_nothing(self):
        build = deepfield.cluster.build
        self.refused("absent.csv", build, self.folder / "absent.csv", self.out)
        self.refused("arrays, expected files", build, particles(10), self.out)
        self.refused("tasks: found 0", self.build, tasks=0)
        self.refused("box.df.job", deepfield.cluster.status, self.job)
        with unittest.mock.patch.dict(sys.modules, {"distributed": None}):
            self.refused("pip install distributed", self.build, "tcp://127.0.0.1:8786")
        self.is_clean("box.csv")
        # What is somebody else's stays as it is.
        self.job.mkdir()
        (self.job / "notes.txt").write_text("mine")
        self.refused("box.df.job", self.build)
        self.assertEqual([path.name for path in self.job.iterdir()], ["notes.txt"])


@unittest.skipUnless(importlib.util.find_spec("distributed"), "Dask is not installed")
class ByWorkers(OfTasks):
    @classmethod
    def setUpClass(cls):
        from distributed import Client, LocalCluster

        settings = {"n_workers": 2, "threads_per_worker": 1, "memory_limit": "1GB", "dashboard_address": None}
        cluster = LocalCluster(processes=True, silence_logs=logging.CRITICAL, **settings)
        cls.addClassCleanup(cluster.close)
        cls.client = Client(cluster)
        cls.addClassCleanup(cls.client.close)

    def test_the_file_is_the_same_where_tasks_run_twice_at_a_time_and_a_worker_is_killed(self):
        with self.assertRaises(Enough):
            self.build(self.client, progress=self.enough(4), keep=True)
        # Both workers run the tasks of the stage that comes next.
        stage, count = next((name, tasks) for name, done, tasks in self.done() if done < tasks)
        for task in range(count):
            run = (deepfield.cluster.run, str(self.job), stage, task)
            workers = self.client.nthreads()
            self.client.gather([self.client.submit(*run, threads=1, workers=[worker], pure=False) for worker in workers])
        self.assertIn((stage, count, count), self.done())
        killed = []

        def kill():
            if not killed:
                killed.append(next(iter(self.client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        stages = self.done()
        data = self.build(self.client, progress=self.after(1 + sum(done for _, done, _ in stages), kill))
        self.assertTrue(killed)
        self.is_as_of_one_process(data)
        # Dask's pages show the tasks of each stage under its name.
        names = self.client.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.task_prefixes))
        of_stages = {f"deepfield-{stage}{end}" for stage, _, _ in stages for end in ("", "-end")}
        self.assertLessEqual({"deepfield-job", *of_stages}, set(names))

    def test_what_fails_on_a_worker_is_told_and_leaves_nothing(self):
        # What others have the same client keep stays theirs.
        kept = self.client.submit(os.getpid, pure=False)
        for tasks in 2, 5, 8:
            with self.assertRaises(Enough):
                self.build(self.client, progress=self.enough(tasks))
            self.is_clean("box.csv")
        self.assertIn(kept.result(), self.client.run(os.getpid).values())
        self.source.unlink()
        self.refused("box.csv", self.build, self.client)
        self.is_clean()
        self.refused("client: found int", self.build, 8786)


if __name__ == "__main__":
    unittest.main()
