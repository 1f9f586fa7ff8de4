"""Builds page files by many processes, on one machine or on many: by the workers of Dask, or one task after another here.

A build is cut into stages, and each stage into tasks that read files and write files, all of them in the folder of a job. So nothing of the data
goes through Dask, and a task that is run again, or twice at a time, does no harm. docs/cluster.md in the project has worked examples.
"""

import collections.abc
import contextlib
import json
import os
import threading
import time
import uuid

from . import _deepfield, asked, building, files, notes, opening, others, progress as progresses

__all__ = ["build", "cancel", "plan", "run", "status"]

# Clusters of Dask have lost their workers over more.
_MOST_TASKS = 50_000
# Numbers of tasks are those of 32 bits.
_LAST_TASK = 2**32 - 1
# How much of a worker's memory its tasks take together: Dask gives a worker no further tasks beyond 80 %, and the interpreter needs some.
_SHARE = 0.65
# How long tasks that are given up are waited for, seconds.
_PATIENCE = 10.0


def build(
    sources,
    out,
    client=None,
    job=None,
    *,
    attributes=None,
    families=None,
    derive=None,
    hierarchy=None,
    smoothing=None,
    tasks=None,
    memory=None,
    threads=None,
    progress=None,
    retries=2,
    resources=None,
    keep=False,
):
    """Builds the page file ``out`` of particles, or the run of several snapshots, by the workers of ``client``, and opens it: the file that
    ``deepfield.build`` makes.

    ``sources`` are a path or several: files of one snapshot, of one table or of a run. ``client`` is a ``dask.distributed.Client`` or the address of
    its scheduler; None has the tasks run here, one after another.

    ``job`` is the folder of what one task leaves for others ["OUT.job"]. Workers have to see it, the sources and ``out`` under the same names, as on a
    cluster's shared file system. A build that finds its job there goes on from where that one was.

    What the file holds, ``attributes``, ``families``, ``derive``, ``hierarchy`` and ``smoothing``, is said as to ``deepfield.build``.

    >>> import deepfield.cluster
    >>> chance = np.random.default_rng(2)
    >>> np.savetxt("points.csv", chance.random((500, 3)), delimiter=",", header="x,y,z", comments="")
    >>> deepfield.cluster.build("points.csv", "points.df").count
    500

    ``tasks`` is into how many tasks the largest stages are cut [by the number of particles; a run has one for each step, and takes no number],
    ``memory`` what each may take, in bytes or as "2GiB" [of a worker's memory its share; here half of what is free], and ``threads`` how many work at
    it [one on a worker, which runs as many tasks as it has threads; here all]. ``retries`` is how often a task that fails is tried again, and
    ``resources`` what it takes of its worker, both as Dask has them.

    ``progress`` is called with the stage, its tasks that are done and their number, or True for a bar. What it raises, Ctrl-C and what fails end the
    build: its tasks are cancelled, and the job is removed, unless ``keep`` is true. It is removed, too, when the file is there.
    """
    wanted = _asked(sources, out, job, building.kept(attributes, families, derive, hierarchy, smoothing), tasks)
    job, _, out, *_ = wanted
    share = (asked.memory(memory), asked.threads(threads))
    is_new, is_planned = not os.path.lexists(job), False
    with _client(client) as client, progresses.teller(progress) as tell:
        runner = _Here(job, share, tell) if client is None else _Workers(client, job, share, tell, {"retries": retries, "resources": resources})
        try:
            stages = runner.plan(wanted)
            is_planned = True
            runner.run(stages)
        except BaseException:
            runner.give_up()
            # A folder that was there, and of which no plan was made, is somebody else's.
            if (is_new or is_planned) and not keep:
                with contextlib.suppress(_deepfield.Error):
                    _deepfield.cluster_remove(job)
            raise
    _deepfield.cluster_remove(job)
    notes.tell(dict.fromkeys(runner.told))
    return opening.open(out)


def plan(
    sources,
    out,
    job=None,
    *,
    attributes=None,
    families=None,
    derive=None,
    hierarchy=None,
    smoothing=None,
    tasks=None,
):
    """Plans the job of a build, all of which is said as to ``build``, for those who start its tasks by other means. Gives what ``status`` does.

    Its ``stages`` come one after the other. The tasks of one may run in any order and at the same time, by all processes that see the files.

    >>> import deepfield.cluster
    >>> chance = np.random.default_rng(2)
    >>> np.savetxt("points.csv", chance.random((500, 3)), delimiter=",", header="x,y,z", comments="")
    >>> job = deepfield.cluster.plan("points.csv", "points.df", tasks=2)
    >>> for stage in job["stages"]:
    ...     for task in range(stage["tasks"]):
    ...         deepfield.cluster.run(job["job"], stage["name"], task)
    >>> deepfield.cluster.cancel(job["job"])
    >>> deepfield.open("points.df").count
    500
    """
    wanted = _asked(sources, out, job, building.kept(attributes, families, derive, hierarchy, smoothing), tasks)
    about, told = _deepfield.cluster_plan(*wanted, None)
    notes.tell(dict.fromkeys(told))
    return json.loads(about)


def run(job, stage, task, *, memory=None, threads=None):
    """Runs a task, counted from 0, of a stage of the job in a folder, as ``deepfield stage`` does; one that is done returns at once. ``memory`` is
    what it may take, in bytes or as "2GiB" [half of what is free], ``threads`` how many work at it [all]."""
    task = asked.whole("task", task, _LAST_TASK, least=0)
    told = _deepfield.cluster_run(_whole(job), stage, task, asked.memory(memory), asked.threads(threads), None)
    notes.tell(dict.fromkeys(told))


def cancel(job):
    """Removes the job in a folder, finished or not, as ``deepfield build --cancel`` does. The file that it has built stays."""
    _deepfield.cluster_remove(_whole(job))


def status(job):
    """How far the job in a folder has come, as ``deepfield build --status`` tells it: ``finished``, ``stages`` with their ``tasks`` and those ``done``,
    ``bytes`` that were ``read``, ``shuffled`` and ``written``, and the rest of what docs/cluster.md lists."""
    return json.loads(_deepfield.cluster_status(_whole(job)))


def _asked(sources, out, job, wanted, tasks):
    """What a job is planned from, as the native part takes it: its folder, the sources, the output, what that holds, and the number of tasks."""
    if isinstance(sources, collections.abc.Mapping) or others.package_of(sources):
        raise _deepfield.Error("sources: found arrays, expected files, which workers can read")
    out = _whole(out)
    job = _whole(f"{out}.job" if job is None else job)
    sources = [_absolute(path) for path in opening.paths_of(sources)]
    return job, sources, out, asked.text(wanted), asked.whole("tasks", tasks, _MOST_TASKS)


def _whole(path):
    """A path that a user names, from the root on."""
    return os.path.abspath(files.expanded(path))


def _absolute(path):
    """A name that means the same in every process; that of a list of names begins with @."""
    is_list = path.startswith("@") and not os.path.lexists(path)
    return "@" + os.path.abspath(path[1:]) if is_list else os.path.abspath(path)


@contextlib.contextmanager
def _client(client):
    """The client of Dask that is meant; None for None."""
    if client is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise _deepfield.Error("client: found no Dask, expected it for builds by workers: pip install distributed") from None
    if isinstance(client, str):
        with Client(client, set_as_default=False) as own:
            yield own
        return
    if not isinstance(client, Client) or client.asynchronous:
        found = "an asynchronous one" if isinstance(client, Client) else type(client).__name__
        raise _deepfield.Error(f"client: found {found}, expected a dask.distributed.Client or the address of its scheduler")
    yield client


class _Here:
    """Runs tasks in this process, one after another."""

    def __init__(self, job, share, tell):
        self._job, self._share, self._tell = job, share, tell
        self.told = []

    def plan(self, plan):
        about, self.told = _deepfield.cluster_plan(*plan, self._tell)
        return json.loads(about)["stages"]

    def run(self, stages):
        for stage in stages:
            name, count = stage["name"], stage["tasks"]
            for task in range(count):
                # While a task runs, too, so that what it raises ends that.
                tell = self._tell and (lambda *_: self._tell(name, task, count))
                self.told += _deepfield.cluster_run(self._job, name, task, *self._share, tell)
                if self._tell:
                    self._tell(name, task + 1, count)

    def give_up(self):
        """A task that was interrupted has ended."""


class _Workers:
    """Has the workers of Dask plan the job and run its tasks."""

    def __init__(self, client, job, share, tell, settings):
        self._client, self._job, self._share, self._tell = client, job, share, tell
        self._settings = settings
        # Of this build alone, so that no key is one of another that failed.
        self._token = uuid.uuid4().hex
        # What is not done yet, by its key. Results of what is done are not held: a worker that is lost with some would have the tasks run again.
        self._futures = {}
        self.told = []

    def _submit(self, stage, task, function, *arguments, **settings):
        # Dask's pages show what comes before the token.
        key = (f"deepfield-{stage}-{self._token}", task)
        future = self._client.submit(function, self._token, *arguments, key=key, pure=False, **settings)
        self._futures[key] = future
        return future

    def _ended(self, futures):
        """The keys of futures and what came of them, in the order in which they end."""
        from distributed import as_completed

        for future in as_completed(futures):
            found = future.result()
            self._futures.pop(future.key, None)
            self.told += found["notes"]
            yield future.key, found

    def plan(self, plan):
        if self._tell:
            self._tell("plan", 0, 0)
        # Not under the name of a stage: that would be the key of its task.
        ((_, found),) = self._ended([self._submit("job", 0, _plan, plan, resources=self._settings["resources"])])
        return found["stages"]

    def run(self, stages):
        count = sum(stage["tasks"] for stage in stages)
        if count >= _MOST_TASKS:
            # A run has a task for each step, however many are asked for.
            advice = "" if stages[0]["name"] == "steps" else ", with a smaller tasks="
            raise _deepfield.Error(f"{self._job}: tasks: found {count}, expected less than {_MOST_TASKS}{advice}")
        counts, done = {stage["name"]: stage["tasks"] for stage in stages}, collections.Counter()
        for (prefix, _), _ in self._ended(self._submitted(stages)):
            name = prefix.removeprefix("deepfield-").removesuffix(f"-{self._token}")
            done[name] += 1
            if self._tell:
                self._tell(name, done[name], counts[name])

    def _submitted(self, stages):
        """The tasks of all stages."""
        tasks, ends = [], {}
        for stage in stages:
            name = stage["name"]
            # One task waits for all of a stage, so that there are as many dependencies as tasks, and not as many as pairs of them.
            after = [ends[before] for before in stage["after"]]
            given = (self._job, name)
            own = [self._submit(name, task, _run, *given, task, *self._share, after, **self._settings) for task in range(stage["tasks"])]
            ends[name] = self._submit(f"{name}-end", 0, _end, own)
            tasks += own
        return tasks

    def give_up(self):
        """Cancels what has not begun, and ends what runs."""
        # What ended the build is told, and not that the scheduler is gone, too.
        with contextlib.suppress(Exception):
            # What nobody wants any more is not begun. (The scheduler's own cancelling meets tasks that it has cancelled already, fails, and drops the client.)
            for future in self._futures.values():
                future.release()
            until = time.monotonic() + _PATIENCE
            while sum(self._client.run(_stop, self._token, on_error="ignore").values()) and time.monotonic() < until:
                time.sleep(0.1)
        self._futures.clear()


# What follows runs on workers.

# Builds that were given up, and how many tasks of each run in this process.
_given_up = set()
_running = collections.Counter()
_counting = threading.Lock()


@contextlib.contextmanager
def _heard(token):
    """While a task runs: what ends it where its build is given up."""

    def tell(*_):
        if token in _given_up:
            raise _deepfield.Error("the build was given up")

    with _counting:
        _running[token] += 1
    try:
        tell()
        yield tell
    finally:
        with _counting:
            _running[token] -= 1


def _stop(token):
    """Gives a build up; how many of its tasks still run."""
    with _counting:
        _given_up.add(token)
        return _running[token]


def _worker_share(memory, threads):
    """What a task may take of the worker that it is on: its share, where nothing is said."""
    from distributed import get_worker

    worker = get_worker()
    limit = worker.memory_manager.memory_limit
    if memory is None and limit:
        memory = int(limit * _SHARE) // worker.state.nthreads
    return memory, threads or 1


def _plan(token, plan):
    with _heard(token) as tell:
        about, told = _deepfield.cluster_plan(*plan, tell)
    return {"stages": json.loads(about)["stages"], "notes": told}


def _run(token, job, stage, task, memory, threads, after):
    with _heard(token) as tell:
        return {"notes": _deepfield.cluster_run(job, stage, task, *_worker_share(memory, threads), tell)}


def _end(token, tasks):
    """What waits for all tasks of a stage."""
    return {"notes": []}
