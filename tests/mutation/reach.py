"""Which tests reach which statements, and what each costs: noted once, and anew for test files that changed.

A probe stands where a run of plain statements begins: at the head of every block, and after every statement that may
leave it. All functions carry theirs at once while the suite runs, file by file in forked processes; what fixtures of a
module or of the session reach counts for every test that asks for them, and so does their time. A test that is not done
after `LONGEST` is ended: of it is known what it has reached by then. Of a test with many cases some are noted: its
others are asked what survives those.
"""

from __future__ import annotations

import ast
import builtins
import gzip
import json
import os
import resource
import tempfile
import time
import zlib
from collections import Counter, defaultdict
from contextlib import suppress
from functools import cache, cached_property
from itertools import accumulate
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

from tests.mutation.change import DoesNotFit, compiled, resolve, switched
from tests.mutation.mutants import TooLong, limited

KEPT = Path(".mutation.json.gz")
LONGEST = 0.3
"""Seconds of work of a test that every mutant is tried on that it reaches, with the fixtures that it needs."""
PROBED = 1.5
"""How many times as long a test may take with all probes."""
ENDLESS = 30.0
"""Seconds of work after which a test is red."""
CALL = 0.003
"""Seconds that any test takes, however little it does."""
CHUNK = 40
"""Tests of one process, at most; all of one file."""
CASES = 6
"""Cases of one test that are noted, about."""
WIDE = ("test_answers.py", "test_judgements.py", "test_measurements.py", "test_programs_kept.py", "test_proofs.py")
"""Files whose tests hold whole answers against those of before: every case of them is noted and asked early, since what
passes all tests of one claim mostly shows there."""
EARLY = 2.0
"""Seconds of work of tests of one claim that come before those, and of those that come before the others."""
BRANCHING = (ast.If, ast.For, ast.While, ast.Try, ast.With, ast.Match)


def segments(tree):
    """Return the first statement of each run of plain statements with its block, and the run in which each stands."""
    first, number = [], {}
    for node in ast.walk(tree):
        for block in (getattr(node, name, None) for name in ("body", "orelse", "finalbody")):
            fresh = True
            for statement in block if isinstance(block, list) else ():
                if fresh:
                    first.append((block, statement))
                number[statement] = len(first) - 1
                fresh = isinstance(statement, BRANCHING)
    return first, number


def key(target, definition, number):
    """Return what a run of statements is called, as long as its function is not changed."""
    return f"{target}#{zlib.crc32(ast.unparse(definition).encode()):x}#{number}"


def probes(definitions):
    """Return for each function one that says `__reached__(key)` in each run of statements, and is the same else."""
    result = {}
    for target, definition in definitions.items():
        tree = ast.parse(ast.unparse(definition)).body[0]
        for k, (block, statement) in enumerate(segments(tree)[0]):
            call = ast.parse(f"__reached__({key(target, definition, k)!r})").body[0]
            block.insert(next(i for i, other in enumerate(block) if other is statement), call)
        with suppress(DoesNotFit, SyntaxError):
            function = resolve(target)
            other = compiled(function, tree)
            other.__defaults__, other.__kwdefaults__ = function.__defaults__, function.__kwdefaults__
            result[function] = other
    return result


def cpu():
    """Return the seconds of work of this process and of those that it started."""
    return time.process_time() + sum(os.times()[2:4])


def red(item, following=None, seconds=ENDLESS):
    """Return whether a test fails; one that takes longer than so many seconds of work, or very long, does."""
    with limited(seconds, cpu=True), limited(20.0 + 10.0 * seconds):
        return any(report.failed for report in runtestprotocol(item, log=False, nextitem=following))


class Reach:
    """The tests that reach each run of statements; as a plugin of pytest it sees what fixtures reach."""

    def __init__(self, path=KEPT):
        self.path, self.files, self.keys, self.tests = path, {}, [], {}
        if path.exists():
            kept = json.loads(gzip.decompress(path.read_bytes()))
            self.files, self.keys, self.tests = kept["files"], kept["keys"], kept["tests"]
        self.number = {name: k for k, name in enumerate(self.keys)}
        self.waiting, self.fixtures = Counter(), {}
        """How many parts of a file are still to be noted; what each fixture reached, and its seconds."""
        self.said, self.read = None, 0
        """What workers say that they reach, a file that they share, and how far it is read."""

    def by_workers(self):
        """Return what forked workers have reached since this was asked."""
        said = os.pread(self.said.fileno(), 1 << 24, self.read) if self.said else b""
        self.read += len(said)
        return set(said.decode().split())

    def in_worker(self):
        """Have a process that was forked say what it reaches, for a second of work."""
        resource.setrlimit(resource.RLIMIT_CPU, (1, resource.RLIM_INFINITY))
        met = set()
        builtins.__reached__ = lambda key: key in met or met.add(key) or self.said.write(f"{key}\n".encode())

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        if fixturedef.scope == "function":
            yield
            return
        outer, hits, start = getattr(builtins, "__reached__", id), set(), cpu()
        builtins.__reached__ = hits.add
        yield
        builtins.__reached__ = outer
        hits |= self.by_workers()
        for each in hits:
            outer(each)
        self.fixtures[fixturedef] = hits, cpu() - start

    def jobs(self, items, definitions):
        """Return what is to be run for the files that are new or changed: (items, function that notes them)."""
        of_file = defaultdict(list)
        for item in items:
            of_file[item.path].append(item)
        changed = {path: some for path, some in of_file.items() if self.files.get(name(path)) != digest(path)}
        parts = [sampled(some) for some in changed.values()]
        chunks = [some[k : k + CHUNK] for some in parts for k in range(0, len(some), CHUNK)]
        self.waiting = Counter(some[0].path for some in chunks)
        others = probes(definitions) if chunks else {}
        return [(some, lambda some=some: self.noted(some, others)) for some in chunks]

    def noted(self, items, others):
        """Return name, seconds and keys of each test of some; of a long one, at least these; of a red one, none."""
        hits, result, most = set(), [], PROBED * LONGEST
        self.said, self.read = tempfile.TemporaryFile(buffering=0), 0  # noqa: SIM115
        os.register_at_fork(after_in_child=self.in_worker)
        with switched(others):
            for item, following in zip(items, [*items[1:], None], strict=True):
                before, failed = set(self.fixtures), True
                builtins.__reached__ = hits.add
                hits.clear()
                start = cpu()
                with suppress(TooLong):
                    failed = red(item, following, most)
                spent = cpu() - start
                of_workers = self.by_workers()
                hits |= of_workers
                if failed and of_workers:  # perhaps because of their end
                    spent = max(spent, most)
                known = not failed or spent >= most
                result.append((item.nodeid, *(self.whole(item, hits, spent, before) if known else (0.0, ()))))
        return result

    def whole(self, item, hits, seconds, before):
        """Return the seconds and keys of a test with all its fixtures, whichever of them it set up itself."""
        mine = {definition for some in item._fixtureinfo.name2fixturedefs.values() for definition in some}
        for fixture, (more, cost) in self.fixtures.items():
            if fixture in mine or fixture not in before:
                hits = hits | more
                seconds += cost if fixture in before else 0.0
        return round(seconds, 3), sorted(hits)

    def take(self, items, entries):
        """Keep what was noted of some tests of one file."""
        for each in items:
            self.tests.pop(each.nodeid, None)
        for nodeid, seconds, hits in entries:
            for each in hits:
                if each not in self.number:
                    self.number[each] = len(self.keys)
                    self.keys.append(each)
            self.tests[nodeid] = [seconds, [self.number[each] for each in hits]]
        path = items[0].path
        self.waiting[path] -= 1
        if not self.waiting[path]:
            self.files[name(path)] = digest(path)

    def save(self):
        kept = {"files": self.files, "keys": self.keys, "tests": self.tests}
        self.path.write_bytes(gzip.compress(json.dumps(kept).encode(), 3))

    @cached_property
    def by_key(self):
        """Names of the tests that reach each key."""
        result = defaultdict(list)
        for nodeid, (_, hits) in self.tests.items():
            for number in hits:
                result[self.keys[number]].append(nodeid)
        return result

    @cached_property
    def longest_case(self):
        """What is noted of the longest case of each test: others are taken for as long."""
        return {test_of(nodeid): entry for nodeid, entry in sorted(self.tests.items(), key=lambda each: each[1][0])}

    def order(self, target, definition, statement, items):
        """Return the quick tests that reach a statement, and the long ones: those first that cost and reach least.

        Before all others come tests that name its module, or the package that it is in, and of all those that reach
        little else: they ask it something, others pass through it. Wide ones follow those that are done at once, by
        their seconds. Long ones that name it are asked even if they were
        ended before they reached it. Of a function that changed since it was noted: the tests that reached it before;
        of one that is new, those that name its module.
        """
        wanted = key(target, definition, segments(definition)[1][statement])
        module = target.partition(":")[0]
        modules = {module, module.rpartition(".")[0]} - {"refkin", "crosscheck"}
        mine = {item.nodeid for item in items.values() if modules & imported(item.path)}
        before = [each for each in self.by_key if each.startswith(f"{target}#")]
        same = [each for each in before if each.rpartition("#")[0] == wanted.rpartition("#")[0]]
        names = {name for each in ([wanted] if same else before) for name in self.by_key.get(each, ())}
        most = PROBED * LONGEST
        quick, wide, long = [], [], []
        reached, noted = ({test_of(nodeid) for nodeid in some} for some in (names, self.tests))
        cases = {nodeid for nodeid in items.keys() - self.tests.keys() if test_of(nodeid) in noted}
        others = {nodeid for nodeid in cases if test_of(nodeid) in reached}
        for nodeid in ((names | mine if names or not before else mine) - cases | others) & items.keys():
            seconds, hits = self.tests.get(nodeid) or self.longest_case.get(test_of(nodeid), (most, []))
            if seconds >= most or nodeid in names or not before:
                cost = (seconds + CALL) * (len(hits) + 1) ** 2 * (1.0 if nodeid in names else 4.0)
                kind = wide if items[nodeid].path.name in WIDE else quick if seconds < most else long
                kind.append((nodeid not in mine, cost, seconds, nodeid))
        quick.sort()
        wide.sort(key=lambda each: each[2])
        early, few = (
            sum(spent < EARLY for spent in accumulate(each[2] + CALL for each in some)) for some in (quick, wide)
        )
        quick[early:early] = wide[:few]
        return [[items[nodeid] for *_, nodeid in some] for some in (quick, sorted(long + wide[few:]))]


def sampled(items):
    """Return about `CASES` cases of each test of some, in their order."""
    of_test = defaultdict(list)
    for item in items:
        of_test[test_of(item.nodeid)].append(item)
    step = {test: 1 if some[0].path.name in WIDE else -(-len(some) // CASES) for test, some in of_test.items()}
    kept = {item for test, cases in of_test.items() for item in cases[:: step[test]]}
    return [item for item in items if item in kept]


def test_of(nodeid):
    """Return the test of which one is a case."""
    return nodeid.partition("[")[0]


def name(path):
    return str(path.relative_to(Path.cwd()))


@cache
def digest(path):
    return f"{zlib.crc32(path.read_bytes()):x}"


@cache
def imported(path):
    """Return the modules that a test file imports, or that it names in full."""
    nodes = [
        n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.ImportFrom | ast.Import)
    ]
    of_from = [(node.module or "", node.names) for node in nodes if isinstance(node, ast.ImportFrom)]
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {module for module, _ in of_from} | {f"{m}.{alias.name}" for m, names in of_from for alias in names}
