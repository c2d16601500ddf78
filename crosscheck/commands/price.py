"""The command `crosscheck price`: a price list on a terminal, as one object of data, or as a small page."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from rich.table import Table

from crosscheck.commands.engines import ENGINES, names, refuse_own
from crosscheck.commands.usage import Json, SceneFile, console, shown_progress, table, writable
from crosscheck.engines.methods import PRICED
from crosscheck.errors import DISAGREEMENT, PASS, UsageError, naming, quoted
from crosscheck.judge.prices import (
    CONTENDS,
    POSES,
    STEPS,
    SUFFIX,
    Cheapest,
    PriceRow,
    cheapest,
    may_be_cheapest,
    repeated,
)
from crosscheck.judge.records import read_file
from crosscheck.judge.truth import NoTruth
from crosscheck.measure.check import key_of
from crosscheck.measure.price import PriceList, time_for
from crosscheck.measure.price import price as measured
from crosscheck.report.prices import looks_of_methods, methods_figure
from crosscheck.report.svg import swatch
from crosscheck.report.wording import filled
from crosscheck.scenes.names import OURS, called
from crosscheck.workers.pool import find_engines
from crosscheck.workers.timing import machine, versions
from refkin.model import Scene
from refkin.scenes.files import load

SAME_WINNERS = 0.95
"""Of the winners that are clear, so many are to win when the list is measured anew."""


def price(
    scene: SceneFile,
    *,
    engines: str = ENGINES,
    as_json: Json = False,
    page: Path | None = None,
    again: Path | None = None,
) -> int:
    """Show what accuracy costs on a scene: every engine by every method, digits against microseconds.

    Exit codes: 0 done, 1 no pose of the scene is certified, so that there is no truth to count digits by; or with
    --again fewer than 95 % of its winners win again, or it has none that is clear; 2 the scene or a file is invalid;
    3 an engine of your own cannot be loaded.
    A method that crashes or hangs has a row that says so.

    Parameters
    ----------
    engines
        Names, separated by commas, or `file.py:Class`; refkin, its fast path and SciPy are priced as well.
    page
        Write a page with the work-precision diagrams to this file, too.
    again
        What an earlier run printed of this scene with --json: measure anew, and say how many of its cheapest methods,
        where they are ahead of the second by more than the spread, are the cheapest again.
    """
    writable("page", page, scene, again)
    ours = [name for name in PRICED if name in OURS]
    asked, subject = (*ours, *names(engines, always=())), load(scene)
    refuse_own(find_engines([spec for spec in asked if ":" in spec])[1])
    before = None if again is None else _earlier(again, subject, asked)
    within = time_for(subject)
    print(f"this takes up to {within:g} s of the processor, on a busy machine longer", file=sys.stderr, flush=True)
    try:
        with shown_progress(None, within / 60, "measurements") as show:
            prices = measured(subject, asked, tell=show)
    except NoTruth as error:
        print(error, file=sys.stderr)
        return DISAGREEMENT
    result, same = to_json(prices, asked), True
    if not as_json:
        print_list(result)
    if before is not None:
        same = print_repeated(before, result, as_json)
    elif as_json:
        print(json.dumps(result, allow_nan=False))
    if page is not None:
        with naming(page):
            page.write_text(page_of(result), encoding="utf-8")
    return PASS if same else DISAGREEMENT


@dataclass(frozen=True)
class _Earlier:
    """Of what `crosscheck price --json` prints: which scene it is of, who was asked, and what that found."""

    schema: Literal[3]
    scene: str
    key: str
    engines: list[str]
    machine: dict[str, str | int | None]
    versions: dict[str, str]
    rows: list[PriceRow]
    cheapest: Cheapest
    cheapest_engine: Cheapest


def _earlier(file: Path, scene: Scene, asked: Sequence[str]) -> dict[str, Cheapest]:
    """Return the winners of an earlier price list; UsageError if it is of another scene, or others were asked.

    A name does not do: lengths are changed under the same one.
    """
    earlier, faults = read_file(file, _Earlier) if file.is_file() else (None, [f"{file} is no file"])
    if earlier is None:
        raise UsageError(f"--again: expected what `crosscheck price --json` prints: {faults[0]}")
    if earlier.key != (expected := key_of(scene)):
        raise UsageError(
            f"--again {file}: expected a price list of {quoted(scene.name)} ({expected}), "
            f"got one of {quoted(earlier.scene)} ({earlier.key})"
        )
    if earlier.engines != (now := _called(asked)):
        raise UsageError(f"--again {file}: expected a price list of {', '.join(now)}, got {', '.join(earlier.engines)}")
    found = winners(list(map(asdict, earlier.rows)))
    if found != {"cheapest": earlier.cheapest, "cheapest_engine": earlier.cheapest_engine}:
        raise UsageError(f"--again {file}: expected the winners that its rows have, got others: it was changed by hand")
    if others := _other(earlier):
        print(f"{file} was measured with other versions, or elsewhere: {others}", file=sys.stderr)
    return found


def _other(earlier: _Earlier) -> str:
    """Return what a list was measured with, and on, that is not as it is now: who wins depends on it."""
    before, now = ({**on, **made_by} for on, made_by in ((earlier.machine, earlier.versions), (machine(), versions())))
    names = [name for name in {**before, **now} if before.get(name) != now.get(name)]
    return "; ".join(f"{name} {before.get(name, 'none')}, now {now.get(name, 'none')}" for name in names)


def _called(asked: Sequence[str]) -> list[str]:
    """Return what those who were asked are called anywhere: of an engine of a user's own the file, not its folder."""
    return sorted(Path(spec).name for spec in asked)


def winners(rows: Sequence[Mapping[str, Any]]) -> dict[str, Cheapest]:
    """Return the cheapest ways of all, and of the engines alone."""
    return {"cheapest": cheapest(rows), "cheapest_engine": cheapest([r for r in rows if r["engine"] not in OURS])}


MADE_ON = "{processor}, {system}, {cores} cores"
SCHEMA = 3
WIDTH = 150
"""Columns of output that goes to no terminal."""


def to_json(prices: PriceList, asked: Sequence[str] = PRICED) -> dict[str, Any]:
    """Return the price list as plain data.

    `key` says of which `scene` it is, whatever the name; `engines` who was `asked`; `machine` and `versions` on what it
    was measured.
    A row has `engine`, `method`, `setting`, `quantity`, `newton_by`, `note`, `digits_attainable`,
    `microseconds_to_build`, and of one cycle `digits`, `microseconds`, `spread`; the same of one pose ends in `_one`,
    and in bulk in `_bulk`. `cheapest` and `cheapest_engine` hold, by `one`, `cycle` and `bulk`, quantity and digits,
    the best offer, its `second`, whether it `differs` from that by more than the spread, and what is `unsure`: an offer
    that was called once, or not asked at all, and may be better than both.
    """
    rows = list(map(asdict, prices.rows))
    return {
        "schema": SCHEMA,
        "scene": prices.scene,
        "key": prices.key,
        "engines": _called(asked),
        "machine": machine(),
        "versions": versions(),
        "rows": rows,
        **winners(rows),
        "times": {"asked": prices.asked, "priced": prices.times, "certified": prices.known},
        "refused": [dict(zip(("engine", "method", "reason"), refused, strict=True)) for refused in prices.refused],
    }


ADAPTERS = (
    "a price is that of an engine through its adapter, in Python: Newton of Pinocchio and MuJoCo is the adapter's, so "
    "are the linear solves of exudyn's rates; what is written out for one mechanism may cost less"
)


def print_list(result: Mapping[str, Any]) -> None:
    """Print a price list (`to_json`)."""
    out = console(WIDTH)
    for poses, name in POSES.items():
        for key, who in (("cheapest", ""), ("cheapest_engine", ", among the engines alone")):
            title = f"{result['scene']}, {name}: the cheapest way to so many digits{who}"
            out.print(cheapest_table(result[key][poses], title))
    out.print(methods_table(result["rows"]))
    for line in lines(result):
        out.print(line)


def print_repeated(before: Mapping[str, Cheapest], now: Mapping[str, Any], as_json: bool) -> bool:
    """Print whether the winners of a price list win again; return whether enough do, of which there must be one.

    Parameters
    ----------
    before, now : mapping
        The `winners` of a list, and the list that was measured now, as the JSON has it.
    as_json : bool
        Whether JSON is printed, or text.
    """
    found = repeated(before, {key: now[key] for key in before})
    share = found.same / found.pairs if found.pairs else None
    if as_json:
        print(json.dumps({**now, "repeated": {**asdict(found), "share": share}}, allow_nan=False))
    else:
        known = "nothing is known of winners" if share is None else f"{share:.1%}"
        of = f"{found.pairs} winners that the earlier list has ahead of the second by more than the spread: {known}"
        print(*found.changed, f"cheapest again are {found.same} of {of}", sep="\n")
        print(f"they are so in {found.same_cells} of {found.cells} cells of the tables")
    return share is not None and share >= SAME_WINNERS


def lines(result: Mapping[str, Any]) -> list[str]:
    """Return what is to be said of a price list beside its rows."""
    times = result["times"]
    made_on = MADE_ON.format(**result["machine"])
    out = [
        ADAPTERS,
        f"one cycle: {times['certified']} configurations; digits are the fewest over them, a price is that of one",
        "one pose now: started at the pose before it, if there is one, with the model built (build -: in every call); "
        "bulk: 1,000 poses over the same time, by who may be the cheapest there (others: -); all of processor time",
        "a difference that exceeds the spread of both prices is marked by <, one that does not by ~; ? is what may be "
        "cheaper than either: it was called once, or there was no time to ask it",
        f"timed once: what has under {STEPS[0]} digits, or takes {CONTENDS:g} times as long as others with as many and "
        "is nobody's second best; such a price is never known to differ",
    ]
    if times["priced"] < times["asked"]:
        out.append(f"a cycle has {times['priced']} of the scene's {times['asked']} times, evenly spread")
    if times["certified"] < times["priced"]:
        without = f"{times['priced'] - times['certified']} of {times['priced']} times"
        out.append(f"{without} are outside the longest run with a certified truth: nobody is asked there")
    if unasked := may_be_cheapest(result["rows"]):
        names = "; ".join(f"{engine}: {called(*how)}" for engine, *how in unasked)
        out.append(f"in bulk may be cheaper, but there was no time to ask: {names}")
    for poses, name in POSES.items():
        if not any(row[f"microseconds{SUFFIX[poses]}"] for row in result["rows"]):
            out.append(f"{name}: nothing was timed, for want of time or of several times in the scene")
    out += [f"{r['engine']}, {r['method']}: refused: {r['reason']}" for r in result["refused"]]
    out.append(", ".join((made_on, *(f"{name} {value}" for name, value in result["versions"].items()))))
    silent = {(r["engine"], r["method"], r["setting"], r["note"]) for r in result["rows"] if r["digits"] is None}
    return out + [f"{', '.join(filter(None, row[:3]))}: {row[3]}" for row in sorted(silent)]


def cheapest_table(cheapest: Mapping[str, Mapping[str, Mapping[str, Any] | None]], title: str) -> Table:
    """Return digits x quantity: who, how, for how many microseconds, and the second best."""
    rows: list[Any] = []
    for step in STEPS:
        rows += [[step, *(_cell(for_quantity[str(step)]) for for_quantity in cheapest.values())], None]
    return table("digits", *cheapest, rows=rows, title=title)


def _cell(best: Mapping[str, Any] | None) -> str:
    if best is None:
        return "nobody"
    second, unsure = best["second"], best["unsure"]
    shown = f"{_offer(best)}\n" + (f"{'<' if best['differs'] else '~'} {_offer(second)}" if second else "nobody else")
    return shown + (f"\n? {_offer(unsure)}" if unsure and unsure != second else "")


def _offer(offer: Mapping[str, Any]) -> str:
    how = ", ".join(filter(None, (offer["method"], offer["setting"])))
    return f"{offer['microseconds']:.1f} us ({offer['digits']:.1f} digits) {offer['engine']}: {how}"


def methods_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return each method at its best setting: of each quantity digits, and us of one pose, a cycle, in bulk.

    All of a line is of one setting: else position could cost more than position with rates. It is the one with the most
    digits of the quantity of which it has fewest.
    """
    quantities = list(dict.fromkeys(row["quantity"] for row in rows))
    numbers = [head for q in quantities for head in (f">{q}\ndigits", ">us: one/\ncycle/bulk")]
    settings: dict[tuple[str, str, str], dict[str, dict[str, Mapping[str, Any]]]] = {}
    for row in rows:
        of_method = settings.setdefault((row["engine"], row["method"], row["newton_by"]), {})
        of_method.setdefault(row["setting"], {})[row["quantity"]] = row
    shown = []
    for (engine, method, newton_by), of_method in settings.items():
        setting = max(of_method, key=lambda one: sorted(_digits(of_method[one].get(q)) for q in quantities))
        best = of_method[setting]
        build = next(iter(best.values()))["microseconds_to_build"]
        texts = [text for q in quantities for text in _digits_and_prices(best.get(q))]
        shown.append(
            [engine, called(method, setting), newton_by, "-" if build is None else f"{build / 1e3:.2g}", *texts]
        )
    title = "Every method at its best, the setting of most digits: these, and what they cost"
    return table("engine", "method", "Newton by", ">build\nms", *numbers, rows=shown, title=title)


def _digits(row: Mapping[str, Any] | None) -> float:
    """Return the digits of a row, fewer than any if there are none."""
    return -1.0 if row is None or row["digits"] is None else float(row["digits"])


def _digits_and_prices(row: Mapping[str, Any] | None) -> tuple[str, str]:
    if row is None or row["digits"] is None:
        return "-", "-"
    prices = [row[f"microseconds{SUFFIX[poses]}"] for poses in POSES]
    return f"{row['digits']:.1f}", "/".join("-" if x is None else f"{x:.{0 if x >= 100 else 1}f}" for x in prices)


def page_of(result: Mapping[str, Any]) -> str:
    """Return the page of a price list (`to_json`); whatever comes from a scene is escaped."""
    rows = result["rows"]
    quantities = list(dict.fromkeys(row["quantity"] for row in rows))
    return filled(
        "price_page.html.j2",
        result=result,
        poses=POSES,
        adapters=ADAPTERS,
        steps=[str(step) for step in STEPS],
        panels=[methods_figure(rows, quantity) for quantity in quantities],
        legend=[(swatch(look), " · ".join(name)) for name, look in looks_of_methods(rows).items()],
    )
