"""`make mutation`: a seeded sample of random mutants, each in a process of its own, against the tests that reach it.

Of the public tools mutmut 3 leaves static methods alone, which all formulas of joints are, and cosmic-ray starts the
whole suite anew for every mutant. Here the suite is collected once. `reach` knows which tests reach the statement of a
mutant, and what each costs; the mutant is put in by `change.switched`, as those of `mutants.toml` are, in a forked
process that runs those tests, the quickest first, until one is red; what survives all quick ones is tried on long ones
while there is time. A test that was red with a mutant has to be green without one in the same way, or its kills do not
count.

`survivors.toml` says of each survivor known so far what it is: "equivalent", "costs only time", "to kill", or "dies
elsewhere". One that is not in it ends the run with exit code 1. Workers are forked from the process that has the
mutant. A test that runs the code in another program sees none, and ends there: what such a test kills, with the change
written into the file, dies elsewhere.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import importlib
import multiprocessing
import os
import pickle
import pkgutil
import random
import resource
import select
import signal
import subprocess
import sys
import time
import tomllib
import warnings
from collections import Counter
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

import pytest

from crosscheck.workers import processes
from tests.mutation.change import DoesNotFit, compiled, resolve, switched
from tests.mutation.operators import change, changes, places
from tests.mutation.reach import Reach, cpu, imported, red

HERE = Path(__file__).parent
PACKAGES = ("refkin", "crosscheck.judge", "crosscheck.measure")
OTHERS = ("commands", "documents", "engines", "night", "problems", "report", "scenes", "workers")
NOTED = (*PACKAGES, *(f"crosscheck.{name}" for name in OTHERS))
"""What tests reach of these is noted; `--only` draws from any of them."""
ELSEWHERE = ("mutation/", "test_house", "test_readme", "browser", "test_cluster", "test_workers")
"""Tests that run the code in other programs, where no mutant is, or that kill processes."""
ALIVE = ("", "not covered")
VERDICTS = ("equivalent", "costs only time", "to kill", "dies elsewhere")
MOST = 8.0
"""Seconds of work in which a mutant may survive quick tests; those that are left are not asked."""
MORE = 3.0
"""How many times as many it may survive long ones."""
LAST = 0.1
"""Part of the time that is kept for asking what was red once more, without a mutant."""


def candidates(packages):
    """Yield every place of every function of some packages where it may be changed: target, tree, place."""
    for name in packages:
        package = importlib.import_module(name)
        below = pkgutil.walk_packages(getattr(package, "__path__", []), f"{name}.")
        for module in (name, *(entry.name for entry in below)):
            for target, node in definitions(module):
                yield from ((target, node, place) for place in places(node))


@cache
def definitions(module):
    """Return the functions and methods of a module by its text: target, tree."""
    tree = ast.parse(Path(importlib.import_module(module).__file__).read_text(encoding="utf-8"))
    return list(functions(tree, f"{module}:"))


def functions(tree, before):
    """Yield the functions and methods of a module, with their targets."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield before + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from functions(node, f"{before}{node.name}.")


def function_of(target, definition):
    """Return the function of a definition; the last of its name, where several have one, is not that of the others."""
    function = resolve(target)
    first = min(node.lineno for node in (definition, *definition.decorator_list))
    if (function.__qualname__, function.__code__.co_firstlineno) != (target.partition(":")[2], first):
        raise DoesNotFit(target)
    return function


def fitting(some, count):
    """Return the first mutants that can be put in: change, function, other function, tree, statement."""
    rows = []
    for target, definition, place in some:
        with suppress(DoesNotFit, SyntaxError):
            function = function_of(target, definition)
            what, tree, statement = change(target, definition, place)
            if what:
                rows.append((what, function, compiled(function, tree), definition, statement))
        if len(rows) == count:
            break
    return rows


class Run:
    """A pytest run that instead of its tests, once each, tries the mutants on them."""

    def __init__(self, given, reach):
        self.workers, self.ends = given.workers, time.monotonic() + 60.0 * given.minutes
        self.deadline = self.ends - LAST * 60.0 * given.minutes
        self.given, self.reach, self.mutants, self.outcomes, self.noting = given, reach, [], {}, 0.0

    def pytest_runtestloop(self, session):
        import matplotlib.font_manager  # noqa: F401  lists a fresh machine's fonts by a program, which is forbidden below
        from hypothesis import Phase, settings  # here: pytest is to import it first

        settings.register_profile(
            "mutation", phases=[Phase.explicit, Phase.generate], database=None, derandomize=True, deadline=None
        )
        settings.load_profile("mutation")
        subprocess.Popen.__init__ = lambda *_, **__: pytest.skip("what runs in another program sees no mutant")
        processes._context = partial(multiprocessing.get_context, "fork")  # workers that have the mutant
        items = [item for item in session.items if not any(part in item.nodeid for part in ELSEWHERE)]
        some = list(candidates(self.given.only or PACKAGES))
        random.Random(self.given.seed).shuffle(some)
        self.mutants = fitting(some, self.given.count)
        print(f"{len(self.mutants)} of {len(some)} mutants, seed {self.given.seed}", file=sys.stderr)
        whole = self.note(items)
        named = {item.nodeid: item for item in items}
        asked = [self.reach.order(what.target, node, at, named) for what, _, _, node, at in self.mutants]
        self.noting, most = cpu(), self.given.seconds
        self.trying([number for number, tests in enumerate(asked) if whole or any(tests)], [q for q, _ in asked], most)
        known = {key for key, (verdict, _) in verdicts().items() if verdict != "to kill"}
        alive = [
            number
            for number, outcome in self.outcomes.items()
            if outcome in ALIVE and asked[number][1] and self.mutants[number][0].key not in known
        ]
        self.trying(alive, [long for _, long in asked], MORE * most)
        self.doubt(named)
        return True

    def trying(self, numbers, asked, most):
        """Try mutants on the tests that each is asked, in so many seconds of work each."""
        jobs = []
        for number in numbers:
            function, other = self.mutants[number][1:3]
            run = partial(killed, function, other, asked[number], most)
            jobs.append((number, run, 100 * most))
        for done, (number, outcome) in enumerate(in_parallel(jobs, self.workers, self.deadline), 1):
            if outcome != "not covered" or number not in self.outcomes:
                self.outcomes[number] = "does not end" if outcome is None else outcome
            if outcome in ALIVE:
                print(f"\r{self.mutants[number][0].key}", file=sys.stderr)
            alive = sum(some in ALIVE for some in self.outcomes.values())
            print(f"\r{done} of {len(jobs)} tried, {alive} alive", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)

    def note(self, items):
        """Bring what is known of the tests up to date, in half the time; return whether it is.

        Files that name most of the modules come first; the next run goes on where this one ends.
        """
        trees = {target: node for target, node, _ in candidates(NOTED) if fits(target, node)}
        modules = {what.target.partition(":")[0] for what, *_ in self.mutants}
        todo = self.reach.jobs(sorted(items, key=lambda item: -len(imported(item.path) & modules)), trees)
        jobs = [(k, run, 1200.0) for k, (_, run) in enumerate(todo)]
        noted, half = 0, (time.monotonic() + self.deadline) / 2
        for done, (k, entries) in enumerate(in_parallel(jobs, self.workers, half), 1):
            if entries is not None:  # a process that died has noted nothing: the next run notes its part
                self.reach.take(todo[k][0], entries)
                noted += 1
            print(f"\r{done} of {len(jobs)} parts of the suite noted", end="", file=sys.stderr, flush=True)
            if done % 4 == 0:
                self.reach.save()
        print(file=sys.stderr)
        self.reach.save()
        return noted == len(jobs)

    def doubt(self, items):
        """Take back the kills of tests that are red without a mutant, too."""
        killers = sorted({outcome for outcome in self.outcomes.values() if outcome in items})
        jobs = [(name, lambda name=name: red(items[name]), 100 * MOST) for name in killers]
        again = dict(in_parallel(jobs, self.workers, self.ends))
        wrong = {name for name, outcome in again.items() if outcome is not False}
        if len(again) < len(killers):
            print(
                f"{len(killers) - len(again)} tests that were red have not been asked without a mutant", file=sys.stderr
            )
        for number, outcome in self.outcomes.items():
            if outcome in wrong:
                print(f"red without a mutant, too: {outcome}", file=sys.stderr)
                self.outcomes[number] = "not tried"


def fits(target, definition):
    with suppress(DoesNotFit):
        return bool(function_of(target, definition))


def killed(function, other, items, most):
    """Return the name of the first test that is red with a mutant; an empty string if it survives them."""
    reached = set()
    resource.setrlimit(resource.RLIMIT_CPU, (int(4 * most) + 10, resource.RLIM_INFINITY))
    builtins.__reached__ = reached.add
    with switched({function: other}), warnings.catch_warnings():
        for item, following in zip(items, [*items[1:], None], strict=True):
            if cpu() > most:
                break
            if red(item, following):
                return item.nodeid
    return "" if reached else "not covered"


def in_parallel(jobs, workers, deadline):
    """Yield (number, result) of each job, run in a forked process; None for one that dies, or takes too much work.

    One that takes too long without that yields nothing: the machine may be busy.
    """
    waiting, running = list(jobs)[::-1], {}
    try:
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
                over = part is not None or has_ended(child)
                if not over and time.monotonic() < ends:
                    continue
                while over and select.select([pipe], [], [], 0)[0] and (part := os.read(pipe, 1 << 20)):
                    parts.append(part)
                with suppress(ProcessLookupError):
                    os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                os.close(pipe)
                del running[pipe]
                if over:
                    yield number, pickle.loads(b"".join(parts)) if parts else None
    finally:
        for _, child, *_ in running.values():
            os.killpg(child, signal.SIGKILL)


def has_ended(child):
    """Return whether a process has ended: what it has left behind may hold its end of a pipe open."""
    return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def forked(run):
    """Start a process that pickles what a function returns into a pipe; return the pipe's end and the process."""
    out, into = os.pipe()
    child = os.fork()
    if child:
        with suppress(ProcessLookupError, PermissionError):
            os.setpgid(child, child)
        os.close(into)
        return out, child
    try:
        os.setpgid(0, 0)
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        with os.fdopen(into, "wb") as pipe:
            pickle.dump(run(), pipe)
    finally:
        os._exit(0)


def verdicts():
    """Return what each of the survivors known so far is, and why, by their keys."""
    kept = tomllib.loads((HERE / "survivors.toml").read_text(encoding="utf-8"))
    return {change: (verdict, why) for verdict, survivors in kept.items() for change, why in survivors.items()}


def told(run):
    """Print the survivors, what became of all, and which verdicts fit no change any more; return the exit code."""
    known, counts, unknown = verdicts(), Counter(), 0
    for number, (what, *_) in enumerate(run.mutants):
        outcome = run.outcomes.get(number, "not tried")
        fate = known.get(what.key, ("unknown", ""))[0] if outcome in ALIVE else outcome
        if outcome in ALIVE:
            print(f"{outcome or 'survived'}: {what.target}, line {what.line}: {fate}")
            print(f"    - {what.old}\n    + {what.new}")
            unknown += fate in ("unknown", "to kill")
        counts[fate if fate in (*VERDICTS, "unknown", "not tried") else "died"] += 1
    gone = list(stale(known))
    for each in gone:
        print(f"no such change any more, take it out of survivors.toml: {each}")
    alive = counts["unknown"] + counts["to kill"]
    died = counts["died"] + counts["dies elsewhere"]
    print(", ".join(f"{counts[fate]} {fate}" for fate in ("equivalent", "costs only time", "not tried")))
    print(f"of those that change an answer {died} of {died + alive} died")
    print(f"{run.noting:.0f} s of work to know which tests reach what, {cpu() - run.noting:.0f} s to try mutants")
    return int(bool(unknown or gone or not run.outcomes))


def stale(known):
    """Yield the keys of survivors whose function no longer has that change."""
    for key in known:
        target, trees = key.partition(": ")[0], []
        with suppress(ImportError):
            trees = [node for name, node in definitions(target.partition(":")[0]) if name == target]
        if not any(any(changes(target, node, key)) for node in trees):
            yield key


def main():
    """Run a sample; exit code 1 if a survivor is not known, or known and still to kill."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=MOST, help="of work in which a mutant may survive quick tests")
    parser.add_argument("--only", action="append", help="a package or module to change, not all of them")
    parser.add_argument("tests", nargs="*", default=["tests"])
    given = parser.parse_args()
    reach = Reach()
    run = Run(given, reach)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # either way what is known by then is printed
    quiet = ["-q", "-s", "-p", "no:cacheprovider", "-p", "no:xdist"]
    with suppress(pytest.PytestUnraisableExceptionWarning):  # of what was left open when tests were ended
        pytest.main([*quiet, *given.tests], plugins=[run, reach])
    return told(run)


if __name__ == "__main__":
    sys.exit(main())
