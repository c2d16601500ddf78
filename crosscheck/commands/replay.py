"""`crosscheck replay` solves one scene on all engines; `crosscheck conform` tests one engine on everything."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path

from crosscheck.commands.engines import (
    ENGINES,
    agreement_table,
    any_answered,
    arbiter_table,
    names,
    refusal_lines,
    refuse_own,
    rows_table,
)
from crosscheck.commands.usage import Json, console, fitted, positive, shown_progress, table
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN, PASS, UsageError, quoted
from crosscheck.judge.known_gaps import told
from crosscheck.measure.conform import LEVELS, LevelFault, Reply, hard_replies, replies, summary
from crosscheck.measure.jobs import by_itself, checkers
from crosscheck.scenes.conformance import questions
from crosscheck.scenes.hard import KINDS
from crosscheck.workers.pool import SECONDS_PER_SCENE, find_engines
from refkin.motion import Status
from refkin.scenes.files import load
from refkin.solving.limits import said_if_long


def replay(
    scene: Path,
    *,
    engines: str = ENGINES,
    features: bool = False,
    expected: Status = Status.OK,
    scene_seconds: float = SECONDS_PER_SCENE,
) -> int:
    """Solve one scene on all engines, and compare.

    Exit codes: 0 all that answer agree (who refuses is named), 1 some disagree, 2 usage or invalid scene, 3 engine
    missing, 4 infrastructure, 5 none that was asked for answers, though there is an answer.

    Parameters
    ----------
    scene
        A scene file, for instance one that a night wrote to its folder `disagreements`.
    engines
        Names, separated by commas, or `file.py:Class`; the closed form is always among the sources.
    features
        Solve also by the features of the engines that a night tests apart.
    expected
        The verdict that the scene was made for: another one is the reference's fault, and no engine's.
    scene_seconds
        An engine that takes longer [s] is stopped, and counts as hanging.
    """
    job = by_itself(load(scene), features=features, expected=expected)
    positive("scene-seconds", scene_seconds)
    installed, missing = find_engines(names(engines))
    refuse_own(missing)
    specs = {name: spec for name, (spec, _) in installed.items()}
    with said_if_long(f"asking {len(specs)} engines"), checkers(1, specs, scene_seconds) as pool:
        record = pool.check_one(job)
    out = console(160)
    if record.reference is None:
        out.print(record.failure)
        return INFRASTRUCTURE
    reference = record.reference
    out.print(f"refkin: {reference.verdict} {reference.message}  smallest singular value {reference.sigma_min:.3g}")
    out.print(agreement_table(record, out.width))
    out.print(fitted(arbiter_table(record), out.width))
    if record.levels:
        out.print(rows_table(record))
    for line in [*refusal_lines(record.refusals), *missing.values(), *pool.unexplained]:
        out.print(line)
    for disagreement in record.disagreements:
        out.print(told(record, disagreement))
    if missing:
        return ENGINE_MISSING
    if record.disagreements:
        return DISAGREEMENT
    if reference.verdict == Status.OK and not any_answered(installed, {answer.engine for answer in record.answers}):
        return NOTHING_RAN
    return PASS


def conform(engine: str, *, as_json: Json = False) -> int:
    """Test an engine on each joint and driver at each level, on statuses, orders of bodies and hard cases.

    Exit codes: 0 all answers are right, 1 some are wrong, 2 usage, 3 engine missing, 5 it answers nothing.

    Parameters
    ----------
    engine
        A name, or `file.py:Class`.
    """
    if not engine.strip():
        raise UsageError(f"ENGINE: expected a name, or `file.py:Class`, got {quoted(engine)}")
    asked = names(engine, always=())
    if len(asked) != 1:
        raise UsageError(f"ENGINE: expected one name, or `file.py:Class`, got {quoted(engine)}")
    installed, missing = find_engines(asked)
    if missing:
        print(*missing.values(), sep="\n", file=sys.stderr)
        return ENGINE_MISSING
    ((name, (spec, version)),) = installed.items()
    replied = list[Reply]()
    try:
        with shown_progress(len(questions()) + len(KINDS), noun="questions") as show:
            for reply in chain(replies(spec), hard_replies(spec)):
                replied.append(reply)
                show(len(replied), reply.about)
    except KeyboardInterrupt:
        _show_replies(f"{name} {version}: what it was asked until it was ended", replied)
        raise
    if as_json:
        answers = {"replies": [asdict(reply) for reply in replied], "summary": summary(replied)}
        print(json.dumps({"schema": 1, "engine": name, "version": version, **answers}))
    else:
        _show_replies(f"{name} {version}: what it was asked", replied)
    if any(reply.faults for reply in replied):
        return DISAGREEMENT
    return PASS if any(reply.answered for reply in replied) else NOTHING_RAN


def _show_replies(title: str, replied: Sequence[Reply]) -> None:
    rows = []
    for reply in replied:
        wrong = ", ".join(dict.fromkeys(fault.level for fault in reply.faults))
        held = ", ".join(reply.levels) if reply.answered else "refused"
        rows.append([reply.about, held, wrong or ("nothing" if reply.answered else "")])
    console(150).print(table("asked about", "held against the reference", "wrong", rows=rows, title=title))
    print("\n".join(lines(replied)))


def lines(replied: Sequence[Reply]) -> list[str]:
    """Return in words what is wrong: each kind of fault once, with where it was met and an example."""
    kinds: dict[tuple[str, str, tuple[str, ...]], list[tuple[str, LevelFault]]] = {}
    for reply in replied:
        for fault in reply.faults:
            kinds.setdefault((fault.level, fault.what, fault.types), []).append((reply.about, fault))
    out = []
    for (_, what, types), met in sorted(kinds.items(), key=lambda item: (LEVELS.index(item[0][0]), item[0][1:])):
        joints = f": {', '.join(types)}" if types else ""
        out.append(f"WRONG: {what}{joints}")
        out.append(f"    asked about {'; '.join(about for about, _ in met)}")
        out += [f"    for instance {met[0][1].example}"] if met[0][1].example else []
    out += _refusals([reply.refusals for reply in replied if not reply.answered])
    out += _refusals([reply.refusals for reply in replied if reply.answered], "not compared")
    answered = sum(reply.answered for reply in replied)
    wrong = sum(bool(reply.faults) for reply in replied)
    counted = f"{answered} of {len(replied)} questions answered, {len(replied) - answered} refused, {wrong} wrong"
    return [*out, *summary(replied), counted]


def _refusals(reasons: Sequence[Sequence[str]], what: str = "refused") -> list[str]:
    """Return each reason once, with how many questions it stands for; those that end differently in one line."""
    kinds: dict[str, list[str]] = {}
    for reason in dict.fromkeys(reason for of_one in reasons for reason in of_one):
        kind, colon, end = reason.rpartition(": ")
        kinds.setdefault(kind + colon, []).append(end)
    counts = {
        kind: sum(any(kind + end in of_one for end in ends) for of_one in reasons) for kind, ends in kinds.items()
    }
    plural = {kind: "s" * (n != 1) for kind, n in counts.items()}
    return [f"{what} ({counts[k]} question{plural[k]}): {k}{', '.join(ends)}" for k, ends in kinds.items()]
