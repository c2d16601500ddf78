"""`make mutation`: a seeded sample of random mutants, each in a process of its own, against the tests that reach it.

Of the public tools mutmut 3 leaves static methods alone, which all formulas of joints are, and cosmic-ray starts the
whole suite anew for every mutant. Here the suite is collected once. A first run notes which tests reach the statement
of which mutant, through a probe before it, and how long each takes; then each mutant is put in by `change.switched`,
as those of `mutants.toml` are, in a forked process that runs those tests, the quickest first, until one is red.

`survivors.toml` says of each survivor known so far what it is: "equivalent", "costs only time", or "to kill". One that
is not in it ends the run with exit code 1. A test that runs the code in another program sees no mutant here.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import importlib
import os
import pickle
import pkgutil
import random
import select
import signal
import sys
import time
import tomllib
import warnings
from collections import defaultdict
from contextlib import suppress
from functools import cache
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

from tests.mutation.change import DoesNotFit, compiled, resolve, switched
from tests.mutation.mutants import TooLong, limited
from tests.mutation.operators import change, places, probed

HERE = Path(__file__).parent
PACKAGES = ("refkin", "crosscheck.judge", "crosscheck.measure.check")
ELSEWHERE = ("mutation/", "test_house", "test_readme", "browser", "bench", "cluster", "workers", "campaign", "timing")
"""Tests that run the code in other programs, where no mutant is, or that measure times."""
MOST = 25.0
"""Seconds of work in which a mutant may survive tests; those that take longer are not asked."""
LONGEST = 4.0
"""Seconds of work of a test that is asked at all."""
CHUNK = 24
"""Tests of one process of the first run."""


def candidates(packages):
    """Yield every place of every function of some packages where it may be changed: target, tree, place."""
    for name in packages:
        package = importlib.import_module(name)
        below = pkgutil.walk_packages(getattr(package, "__path__", []), f"{name}.")
        for module in (name, *(entry.name for entry in below)):
            tree = ast.parse(Path(importlib.import_module(module).__file__).read_text(encoding="utf-8"))
            for target, node in functions(tree, f"{module}:"):
                yield from ((target, node, place) for place in places(node))


def functions(tree, before):
    """Yield the functions and methods of a module, with their targets."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield before + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from functions(node, f"{before}{node.name}.")


def fitting(some, count):
    """Return the first mutants that can be put in: change, function, other function, tree."""
    rows = []
    for target, definition, place in some:
        try:
            what, tree = change(target, definition, place)
            function = resolve(target)
            if what and function.__qualname__ == target.partition(":")[2]:
                rows.append((what, function, compiled(function, tree), definition))
        except (DoesNotFit, SyntaxError):
            continue
        if len(rows) == count:
            break
    return rows


class Run:
    """A pytest run that instead of its tests, once each, tries the mutants on them."""

    def __init__(self, given):
        self.workers, self.deadline = given.workers, time.monotonic() + 60.0 * given.minutes
        self.given, self.mutants, self.outcomes, self.whole = given, [], {}, False

    def pytest_runtestloop(self, session):
        from hypothesis import Phase, settings  # here: pytest is to import it first

        settings.register_profile(
            "mutation", phases=[Phase.explicit, Phase.generate], database=None, derandomize=True, deadline=None
        )
        settings.load_profile("mutation")
        some = list(candidates(self.given.only or PACKAGES))
        random.Random(self.given.seed).shuffle(some)
        self.mutants = fitting(some, self.given.count)
        print(f"{len(self.mutants)} of {len(some)} mutants, seed {self.given.seed}", file=sys.stderr)
        items = [item for item in session.items if not any(part in item.nodeid for part in ELSEWHERE)]
        reached = self.reach(items)
        jobs = []
        for number, mutant in enumerate(self.mutants):
            asked, total = [], 0.0
            for seconds, index in sorted(reached[number]):
                if seconds > LONGEST or total + seconds > MOST:
                    break
                asked, total = [*asked, items[index]], total + seconds
            jobs.append((number, lambda m=mutant, asked=asked: killed(m, asked), 30.0 + 10.0 * total))
            if not asked:
                self.outcomes[number] = "not covered" if self.whole else "not tried"
        jobs = [job for job in jobs if job[0] not in self.outcomes]
        for number, outcome in in_parallel(jobs, self.workers, self.deadline):
            self.outcomes[number] = "does not end" if outcome is None else outcome
        return True

    def reach(self, items):
        """Return for each mutant the tests that reach it and are green without it, as (seconds, index of the item)."""
        wanted = defaultdict(list)
        for number, (what, function, _, definition) in enumerate(self.mutants):
            wanted[function, definition].append((what.place, number))
        probes = {function: compiled(function, probed(tree, numbers)) for (function, tree), numbers in wanted.items()}
        chunks = [range(k, min(k + CHUNK, len(items))) for k in range(0, len(items), CHUNK)]
        modules = {what.target.partition(":")[0] for what, *_ in self.mutants}
        jobs = [(k, lambda some=some: noted(items, some, probes), 600.0) for k, some in enumerate(chunks)]
        jobs.sort(key=lambda job: -max(named(items[index].path, modules) for index in chunks[job[0]]))
        reached, half = defaultdict(list), (time.monotonic() + self.deadline) / 2
        for done, (_, entry) in enumerate(in_parallel(jobs, self.workers, half), 1):
            for index, seconds, hits in entry or ():
                for number in hits:
                    reached[number].append((seconds, index))
            print(f"\r{done} of {len(chunks)} parts of the suite", end="", file=sys.stderr, flush=True)
            self.whole = done == len(chunks)
        print(file=sys.stderr)
        return reached


@cache
def imported(path):
    """Return the modules that a test file imports, or that it names in full."""
    text = path.read_text(encoding="utf-8")
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom | ast.Import)]
    of_from = [(node.module or "", node.names) for node in nodes if isinstance(node, ast.ImportFrom)]
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {module for module, _ in of_from} | {f"{m}.{alias.name}" for m, names in of_from for alias in names}


def named(path, modules):
    """Return how many of some modules a test file imports: the files that import most are run first."""
    return len(imported(path) & modules)


def noted(items, some, probes):
    """Return index, seconds and mutants reached of each test that is green, of some."""
    hits, result = set(), []
    builtins.__reached__ = hits.add
    with switched(probes):
        for index in some:
            hits.clear()
            start = time.process_time()
            with suppress(TooLong), limited(2 * LONGEST):
                if not red(items[index]):
                    result.append((index, time.process_time() - start, sorted(hits)))
    return result


def killed(mutant, items):
    """Return the name of the first test that is red with a mutant; an empty string if it survives them."""
    _, function, other, _ = mutant
    with switched({function: other}), warnings.catch_warnings():
        return next((item.nodeid for item in items if red(item)), "")


def red(item):
    return any(report.failed for report in runtestprotocol(item, log=False, nextitem=None))


def in_parallel(jobs, workers, deadline):
    """Yield (number, result) of each job, run in a forked process; None for one that takes too long, or dies."""
    waiting, running = list(jobs)[::-1], {}
    while (waiting and time.monotonic() < deadline) or running:
        while waiting and len(running) < workers and time.monotonic() < deadline:
            number, run, seconds = waiting.pop()
            pipe, child = forked(run)
            running[pipe] = number, child, time.monotonic() + seconds, []
        ready = select.select(list(running), [], [], 0.2)[0]
        for pipe, (number, child, ends, parts) in list(running.items()):
            part = os.read(pipe, 1 << 20) if pipe in ready else None
            if part:
                parts.append(part)
                continue
            if part is None and time.monotonic() < ends:
                continue
            if part is None:
                os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os.close(pipe)
            del running[pipe]
            yield number, pickle.loads(b"".join(parts)) if part is not None and parts else None


def forked(run):
    """Start a process that pickles what a function returns into a pipe; return the pipe's end and the process."""
    out, into = os.pipe()
    child = os.fork()
    if child:
        os.close(into)
        return out, child
    try:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        with os.fdopen(into, "wb") as pipe:
            pickle.dump(run(), pipe)
    finally:
        os._exit(0)


def verdicts():
    """Return what is said of the survivors known so far, by their keys."""
    path = HERE / "survivors.toml"
    known = tomllib.loads(path.read_text(encoding="utf-8")).get("survivor", []) if path.exists() else []
    return {each["change"]: each for each in known}


def told(run):
    """Print the survivors and the counts; return the exit code."""
    known, unknown = verdicts(), []
    for number, (what, *_) in enumerate(run.mutants):
        outcome = run.outcomes.get(number, "not tried")
        if outcome in ("", "not covered", "not tried"):
            verdict = known.get(what.key, {}).get("verdict", "UNKNOWN")
            print(f"{outcome or 'survived'}: {what.target}, line {what.line}: {verdict}")
            print(f"    - {what.old}\n    + {what.new}")
            unknown += [what] if verdict in ("UNKNOWN", "to kill") and outcome != "not tried" else []
    tried = [outcome for outcome in run.outcomes.values() if outcome != "not tried"]
    dead = sum(outcome not in ("", "not covered") for outcome in tried)
    print(f"{dead} of {len(tried)} mutants died; {len(unknown)} survivors are unknown or still to kill")
    return int(bool(unknown))


def main():
    """Run a sample; exit code 1 if a survivor is not known, or known and still to kill."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", action="append", help="a package or module to change, not all of them")
    parser.add_argument("tests", nargs="*", default=["tests"])
    given = parser.parse_args()
    run = Run(given)
    quiet = ["-q", "-s", "-p", "no:cacheprovider", "-p", "no:xdist"]
    with suppress(pytest.PytestUnraisableExceptionWarning):  # of what was left open when tests were ended
        pytest.main([*quiet, *given.tests], plugins=[run])
    return told(run)


if __name__ == "__main__":
    sys.exit(main())
