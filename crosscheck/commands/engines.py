"""`crosscheck engines`, names of engines, and tables of capabilities, of agreement, of a night's verdict."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from rich.table import Table

from crosscheck.commands.usage import console, table
from crosscheck.engines import ELEMENTS, PEERS, Engine, Level, Support
from crosscheck.engines.loading import available, unknown
from crosscheck.engines.loading import load as load_engine
from crosscheck.errors import ENGINE_MISSING, PASS, CannotRun, UsageError, quoted
from crosscheck.judge.records import QUANTITIES, Record, RefusalRow
from crosscheck.night.plan import ALWAYS, SAMPLED, NightOutcome
from crosscheck.report.wording import seeding
from crosscheck.workers.pool import find_engines

ENGINES = ",".join(PEERS)
WIDE = 130
"""Characters that the table of agreement needs."""


def print_engines() -> int:
    """Print what each engine can do: joint x engine x level, and why not where it refuses."""
    installed, missing = find_engines(tuple(sorted(available())))
    out = console(160)
    out.print(capability_table(load_engine(spec) for spec, _ in installed.values()))
    for name, (_, version) in installed.items():
        out.print(f"{name} {version}")
    for reason in missing.values():
        out.print(reason)
    return PASS


def names(text: str, always: tuple[str, ...] = (ALWAYS, *SAMPLED)) -> tuple[str, ...]:
    """Return the names in a list separated by commas; an engine nobody has heard of is a usage error."""
    named = [name.strip() for name in text.split(",") if name.strip()]
    known = available()
    if text and not named:
        raise UsageError(f"--engines: expected names of engines, separated by commas, got {quoted(text)}")
    for name in named:
        if name not in known and ":" not in name:
            raise UsageError(unknown(name, known))
    return tuple(dict.fromkeys((*always, *named)))


class NotLoaded(CannotRun):
    """An engine of a user's own that is not there, or cannot be loaded."""

    code = ENGINE_MISSING


def refuse_own(missing: Mapping[str, str]) -> None:
    """Raise NotLoaded if `missing`, asked -> why not, has an engine of a user's own: others may not be installed."""
    if own := [reason for spec, reason in missing.items() if ":" in spec]:
        raise NotLoaded("\n".join(own))


MOST_LINES = 20
"""Disagreements, and failures, that a terminal shows; the report has all."""
PLACES = ("inside", "outside", "undecidable", "no_answer")


def any_answered(installed: Iterable[str], answering: Collection[str]) -> bool:
    """Return whether any engine that was asked for has answered, and say it where none has."""
    asked = [name for name in installed if name not in (ALWAYS, *SAMPLED)] or [*installed]
    answered = not {*asked}.isdisjoint(answering)
    if not answered:
        print(f"nothing was compared: no answer of {', '.join(asked)}", file=sys.stderr)
    return answered


def capability_table(engines: Iterable[Engine]) -> Table:
    """Return element x engine x level: native, derived, or refused with its reason."""
    rows: list[Any] = []
    for engine in engines:
        known = engine.capabilities()
        for key in ELEMENTS:
            levels = known.get(key, {})
            cells = [str(levels[level].support) if level in levels else Support.REFUSED.value for level in Level]
            reasons = {levels[level].reason for level in levels if levels[level].reason}
            rows.append([engine.name, key, *cells, "; ".join(sorted(reasons))])
        rows.append(None)
    return table("engine", "element", *Level, "why not", rows=rows, title="What engines can do")


def agreement_table(record: Record, width: int = WIDE) -> Table:
    """Return engine and method x quantity: worst digits and worst error / allowed, and who did what.

    Where digits are counted at fewer poses than were answered, as where no budget holds, the cell says at how many.
    Where there is less room a quantity has a row of its own, and who did what is left out.
    """
    numbers = [head for quantity in QUANTITIES for head in (f">{quantity}\nworst\ndigits", ">error/\nallowed")]
    rows = []
    for answer in record.answers:
        method = answer.method
        cells = [answer.engine, method.name, method.newton_by, seeding(method.seeding)]
        for quantity in QUANTITIES:
            numbers_of = answer.quantities.get(quantity)
            counts = sum(map(Counter, numbers_of.digits_by_sigma.values()), Counter()) if numbers_of else Counter()
            judged, given = counts.total(), answer.times - answer.missing
            few = f" at {judged} of {given}" * (judged < given)
            cells.append(f"{min(counts) / 10:.1f}{few}" if counts else "-")
            cells.append("-" if numbers_of is None or numbers_of.ratio is None else f"{numbers_of.ratio:.2g}")
        rows.append([*cells, f"{answer.missing} of {answer.times}"])
    heads = ("engine", "method", "Newton by", "given", *numbers, ">no\nanswer")
    if width < WIDE:
        pairs = [(name, 4 + 2 * k) for k, name in enumerate(QUANTITIES)]
        rows = [[*row[:2], name, *row[k : k + 2], row[-1]] for row in rows for name, k in pairs]
        heads = ("engine", "method", "quantity", ">worst\ndigits", heads[5], heads[-1])
    return table(*heads, rows=rows, title=f"{record.scene}: agreement with refkin")


def rows_table(record: Record) -> Table:
    """Return the comparison of the engines' own rows at configurations that are not assembled."""
    rows = []
    for row in record.levels:
        worst = f"{min(row.digits) / 10:.1f}" if row.digits else "-"
        ratio = "-" if row.ratio is None else f"{row.ratio:.2g}"
        rows.append([row.engine, row.level, row.rows, worst, ratio])
    heads = ("engine", "own rows", "rows", "worst digits", "error/allowed")
    return table(*heads, rows=rows, title="Translation of the model")


def arbiter_table(record: Record) -> Table:
    """Return where each answer lies by the certificate: at how many times, and the farthest, in least errors."""
    rows = []
    for answer in record.answers:
        certificate = answer.certificate
        cells = [str(getattr(certificate, place)) for place in PLACES] if certificate else ["-"] * len(PLACES)
        worst = "-" if certificate is None or certificate.radii is None else f"{certificate.radii:.2g}"
        rows.append([answer.engine, answer.method.name, *cells, worst])
    heads = ("engine", "method", *(f">{place.replace('_', ' ')}" for place in PLACES), ">worst, radii")
    title = "Positions by the certificate (113 bits), within what float64 can attain"
    return table(*heads, rows=rows, title=title)


def refusal_lines(refusals: Iterable[RefusalRow]) -> list[str]:
    """Return what engines refuse, in one line for each engine, level and reason."""
    joints: dict[tuple[str, str, str], list[str]] = {}
    for row in refusals:
        joints.setdefault((row.engine, row.level, row.reason), []).append(
            f"{row.joint} {row.name!r}" if row.joint else ""
        )
    return [
        f"{engine} refuses {', '.join(names)} at {level}: {reason}"
        if all(names)
        else f"{engine} refuses: {reason}" * (engine not in reason) or reason
        for (engine, level, reason), names in joints.items()
    ]


def outcome_lines(outcome: NightOutcome) -> list[str]:
    """Return how a night ended, in lines that a log can hold; what was counted is in the report."""
    lines = [f"new: {c.disagreement}{f'  ({c.file})' if c.file else ''}" for c in outcome.new[:MOST_LINES]]
    lines += [f"failed: {text}" for text in outcome.failed[:MOST_LINES]]
    lines += [f"missing: {name}: {reason}" for name, reason in outcome.missing.items()]
    for gap, chances in outcome.possibly_closed:
        which = f"{gap.predicate}: {', '.join(gap.match.values())}"
        row = f"the gap of {gap.engine} known since {gap.date} ({which})"
        lines.append(f"possibly closed: {row} showed in none of {chances} scenes of its kind")
    for gap, scenes in outcome.found_again:
        when = f"met again by scene {scenes}" if scenes else "not met again"
        lines.append(f"known gap {when}: {gap.engine}, {gap.reproduction}")
    if outcome.new:
        lines.append(f"simplifying disagreements took {outcome.shrinking_seconds:.0f} s")
    return lines
