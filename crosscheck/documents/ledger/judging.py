"""A row recomputed, and held against what it states: each number by each part of the project that computes it."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from flint import arb, ctx

from crosscheck.documents.ledger.arithmetic import ArbNumbers, Binary64
from crosscheck.documents.ledger.rows import (
    Erratum,
    LedgerRow,
    Printed,
    Value,
    Written,
    correct_digits,
    leaves,
    printed_is,
)

JUDGE_BITS = 256
"""Bits of the balls that enclose the truth, and of every comparison."""
ROUNDING_BITS = 53
SAFETY = 2.0
"""Balls take sines and roots as rounded to half a unit; NumPy's may err by one, and sums come in another order."""
MOST_BINARY64 = 15
"""Digits beyond which a stated truth must be enclosed: binary64 holds no more for certain."""
TRUTH = f"balls of {JUDGE_BITS} bits"
OTHERS = ("loops", "refkin", "scan")  # vector loops, the reference, all readings of a lost figure

Sources = dict[str, dict[str, Any]]
"""What each source has computed: path -> number, word, or yes and no."""


def computed(row: LedgerRow) -> tuple[Sources, dict[str, Any]]:
    """Return what each source makes of a row, and the radius of each number on balls of 53 bits."""
    sources: Sources = {}
    radii: dict[str, Any] = {}
    if compute := _function(row):
        sources[Binary64.name] = _flat(compute(Binary64(), row.inputs))
        for bits in (JUDGE_BITS, ROUNDING_BITS):
            balls = ArbNumbers(bits)
            with balls.at_precision():
                values = _flat(compute(balls, row.inputs))
            if bits == JUDGE_BITS:
                sources[TRUTH] = values
            else:
                radii = {path: x.rad() for path, x in values.items() if isinstance(x, arb)}
    for name in OTHERS:
        if compute := _function(row, f"{name}_"):
            sources[name] = _flat(compute(Binary64(), row.inputs))
    return sources, radii


def check_row(row: LedgerRow) -> dict[str, Any]:
    """Return a row with what was found out about it, as plain data; `status` is pass, fail or open."""
    with ctx.workprec(JUDGE_BITS):
        sources, radii = computed(row)
        checked = [values for value in row.values for values in _judged(value, sources, radii)]
        failures = [f"{t['name']}: {text}" for t in checked for text in t.pop("failures")]
        stated = {t["name"] for t in checked}
        unstated = sorted({path for values in sources.values() for path in values} - stated)
        failures += [f"{path}: computed, but not stated" for path in unstated]
        errata = [_erratum(e, checked, sources) for e in row.errata]
        failures += [text for e in errata for text in e.pop("failures")]
        failures += _uncovered(row.errata, checked)
    if not checked and not row.open:
        failures.append("nothing is checked")
    status = "fail" if failures else "open" if row.open else "pass"
    return {
        **{key: getattr(row, key) for key in ("id", "document", "item", "inferred", "open", "note")},
        "computation": f"{row.module}:{row.id.lower()}" if TRUTH in sources else "",
        "inputs": {key: _plain(value) for key, value in row.inputs.items()},
        "computed_by": list(sources),
        "status": status,
        "failures": failures,
        "values": checked,
        "errata": errata,
    }


def _function(row: LedgerRow, by: str = "") -> Callable[..., dict[str, Any]] | None:
    """Return what recomputes a row, or does so by another part of the project; None if nothing does."""
    module = importlib.import_module(f"crosscheck.documents.ledger.{row.module}")
    return getattr(module, f"{by}{row.id.lower()}", None)


def _flat(values: Mapping[str, Any]) -> dict[str, Any]:
    trees = {name: _plain(tree) for name, tree in values.items()}
    return {path: leaf for name, tree in trees.items() for path, leaf in leaves(name, tree)}


def _plain(tree: Any) -> Any:
    """Return a tree with lists for arrays and tuples, and Python's own numbers for NumPy's."""
    if isinstance(tree, np.ndarray):
        return [_plain(part) for part in tree.tolist()]
    if isinstance(tree, list | tuple):
        return [_plain(part) for part in tree]
    return tree.item() if isinstance(tree, np.generic) else tree


def _judged(value: Value, sources: Sources, radii: Mapping[str, Any]) -> list[dict[str, Any]]:
    if value.between is not None:
        paths = [p for values in sources.values() for p in values if p == value.name or p.startswith(value.name + "[")]
        leaf_truths: dict[str, Any] = dict.fromkeys(paths or [value.name])
    else:
        leaf_truths = dict(leaves(value.name, value.truth))
    printed = dict(leaves(value.name, value.printed)) if value.printed is not None else {}
    checked = [_leaf(value, path, truth, sources, radii, printed.pop(path, "")) for path, truth in leaf_truths.items()]
    if any(printed.values()):
        checked[-1]["failures"].append(f"printed, but without a truth: {sorted(k for k, v in printed.items() if v)}")
    return checked


def _leaf(
    value: Value, path: str, truth: Any, sources: Sources, radii: Mapping[str, Any], printed: str
) -> dict[str, Any]:
    failures, by = [], {}
    for source, values in sources.items():
        if path in values:
            by[source] = _shown(values[path])
            failures += [f"{source}: {text}" for text in _compared(value, truth, values[path], source, radii.get(path))]
    if not by:
        failures.append("not computed")
    elif TRUTH not in by and _is_number(truth) and Written.read(truth).digits > MOST_BINARY64:
        failures.append(f"stated to {Written.read(truth).digits} digits, but not enclosed")
    checked = {"name": path, "truth": truth, "between": value.between, "computed": by, "failures": failures}
    return {**checked, **_printed(printed, truth, sources.get(TRUTH, {}).get(path))}


def _printed(printed: str, truth: Any, enclosed: Any) -> dict[str, Any]:
    """Return what a printed number is; its digits are counted against the enclosed truth, else the stated one."""
    if not printed:
        return {"printed": None}
    number, against = Written.read(printed), arb(enclosed if enclosed is not None else str(truth))
    return {
        "printed": printed,
        "verdict": printed_is(number, against).value,
        "digits_printed": number.digits,
        "digits_correct": correct_digits(number, against),
    }


def _compared(value: Value, truth: Any, computed: Any, source: str, radius: Any) -> list[str]:
    """Return why a computed leaf is not what is stated, if it is not."""
    if value.between is not None:
        low, high = (arb(end) for end in value.between)
        inside = isinstance(computed, int | float | arb) and low <= arb(computed) <= high
        return [] if inside else [f"{_shown(computed)} is not between {value.between[0]} and {value.between[1]}"]
    if not _is_number(truth):
        same = type(computed) is type(truth) and computed == truth
        return [] if same else [f"{_shown(computed)} is not {truth!r}"]
    if isinstance(computed, bool | str) or (isinstance(computed, float) and not np.isfinite(computed)):
        return [f"{_shown(computed)} is not {truth}"]
    stated = Written.read(truth)
    allowed = stated.half * (1 + arb(2) ** -50)
    if source != TRUTH and radius is not None:
        allowed += SAFETY * radius
    away = abs(arb(computed) - stated.value)
    off = f"{_shown(computed)} is not {truth}: off by {float(away):.2g}, allowed {float(allowed):.2g}"
    return [] if away <= allowed else [off]


def _erratum(erratum: Erratum, rows: list[dict[str, Any]], sources: Sources) -> dict[str, Any]:
    """Return an erratum as plain data with what its printed numbers are, and what of it does not hold."""
    failures, by_name = [], {t["name"]: t for t in rows}
    where = ", ".join(erratum.at) or erratum.shown_by or erratum.cause[:40]
    for path in erratum.at:
        checked = by_name.get(path, {})
        if checked.get("verdict") != erratum.kind:
            verdict = checked.get("verdict", "not printed")
            failures.append(f"erratum {path}: stated as {erratum.kind}, but it is {verdict}")
    if erratum.explained_by:
        for path, other in zip(erratum.at, erratum.explained_by, strict=True):
            failures += _explained(by_name.get(path, {}).get("printed") or "", other, sources)
    if erratum.kind in ("wrong", "truncated") and not erratum.at:
        failures.append(f"erratum {where}: names no printed number")
    if erratum.kind in ("formula", "claim"):
        failures += _refuted(erratum, where, sources)
    keys = ("kind", "cause", "explained_by", "shown_by", "claimed", "counts", "reading")
    return {"at": list(erratum.at), **{key: _plain(getattr(erratum, key)) for key in keys}, "failures": failures}


def _refuted(erratum: Erratum, where: str, sources: Sources) -> list[str]:
    """Return why a formula or a claim is not shown to be wrong: nobody computes what shows it, or it is as claimed."""
    path, claimed = erratum.shown_by, erratum.claimed
    if claimed is None or not any(path in values for values in sources.values()):
        return [f"erratum {where}: nothing shows it"]
    stated = Value(name=path, truth=claimed)
    right = [
        s for s, values in sources.items() if path in values and not _compared(stated, claimed, values[path], s, None)
    ]
    return [f"erratum {where}: {claimed} is claimed, and right by {', '.join(right)}"] if right else []


def _explained(printed: str, path: str, sources: Sources) -> list[str]:
    value = sources.get(TRUTH, {}).get(path, sources.get(Binary64.name, {}).get(path))
    if value is None or not printed or printed_is(Written.read(printed), arb(value)) is Printed.WRONG:
        return [f"erratum: {printed} is not {path}, {'which is not computed' if value is None else _shown(value)}"]
    return []


def _uncovered(errata: tuple[Erratum, ...], rows: list[dict[str, Any]]) -> list[str]:
    """Return the printed numbers that are not right and that no erratum names."""
    named = {path for erratum in errata for path in erratum.at}
    off = [t for t in rows if t.get("verdict") not in (None, Printed.RIGHT.value) and t["name"] not in named]
    return [f"{t['name']}: {t['printed']} is printed, which is {t['verdict']}: no erratum says so" for t in off]


def _is_number(truth: Any) -> bool:
    """Return whether a stated truth is a decimal number, which is text; what is yes, no, a count or a word is not."""
    try:
        return isinstance(truth, str) and bool(Written.read(truth).text)
    except ValueError:
        return False


def _shown(value: Any) -> str:
    """Return a computed leaf as text: a float to the last bit, a ball to the digits that it proves, 30 at most."""
    if isinstance(value, arb):
        known = value.rad() < arb(2) ** -120 * (1 + abs(value))
        return str(value.str(30, radius=False) if known else value.str(17))
    return repr(value) if isinstance(value, float) else str(value)
