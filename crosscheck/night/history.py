"""Nights kept in one SQLite file: verdicts, digits and times, and where the level of a time changed.

Accuracy is compared on the golden set, where a change fails the night. A change of times is only a warning, since
the load of a machine varies. Times are divided by the reference's own time in the same night.

Changes of level are told from noise by a penalty that the noise itself scales. The series is cut into pieces of
constant level so that the squared distances from the levels, plus a price per cut, are least (optimal partitioning;
Jackson et al., IEEE Signal Processing Letters 12, 2005). Three things make it fit for times:

* logarithms: a machine is slower by a factor;
* a running median of five takes outliers out, two in a row included, before anything is cut;
* a cut costs 4 log(n) times the variance of the noise, and the noise is estimated from the differences of neighbours,
  which a change of level disturbs only once.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.errors import CannotRun, kept
from crosscheck.night.plan import TRENDS, replace_file
from crosscheck.scenes.names import QUANTITIES

REFERENCE = "refkin"
LATEST = 7
"""Of so many nights a change of level is a warning."""
MOST_TRENDS = 24
"""Series whose course is kept in a report, those that changed first; the history has all."""
TABLES = """
CREATE TABLE IF NOT EXISTS night (
    id INTEGER PRIMARY KEY, date TEXT NOT NULL, seed TEXT NOT NULL, verdict TEXT NOT NULL, scenes INTEGER NOT NULL,
    configurations INTEGER NOT NULL, new INTEGER NOT NULL, known INTEGER NOT NULL, versions TEXT NOT NULL,
    UNIQUE (date, seed));
CREATE TABLE IF NOT EXISTS accuracy (
    night INTEGER NOT NULL REFERENCES night (id), engine TEXT NOT NULL, method TEXT NOT NULL, quantity TEXT NOT NULL,
    digits_median REAL, digits_p01 REAL, digits_worst REAL, worst_over_allowed REAL);
CREATE TABLE IF NOT EXISTS cost (
    night INTEGER NOT NULL REFERENCES night (id), series TEXT NOT NULL,
    microseconds REAL NOT NULL, ratio REAL NOT NULL, priced INTEGER NOT NULL);
"""

SOUND = {
    "night": "typeof(date) = 'text' AND typeof(seed) = 'text' AND typeof(verdict) = 'text'"
    " AND typeof(scenes) = 'integer' AND typeof(new) = 'integer' AND typeof(known) = 'integer'"
    " AND CASE WHEN json_valid(versions) THEN json_type(versions) = 'object' ELSE 0 END",
    "accuracy": "typeof(engine) = 'text' AND typeof(method) = 'text' AND typeof(quantity) = 'text'"
    " AND typeof(digits_median) = typeof(digits_worst) AND (digits_worst IS NULL"
    " OR typeof(digits_worst) = 'real' AND abs(digits_worst) < 1e300 AND abs(digits_median) < 1e300)",
    "cost": "typeof(series) = 'text' AND typeof(ratio) = 'real' AND ratio > 0.0 AND ratio < 1e300",
}
"""What holds of each row that a night has written: SQLite itself keeps any text in a column of numbers."""


HEADER = b"SQLite format 3\0"
"""With which every database of SQLite begins."""


class HistoryError(CannotRun):
    """A file that is no history, or that cannot be read or written."""


def remember(path: Path, report: Mapping[str, Any], folder: Path) -> dict[str, Any] | None:
    """Add a night to a history, and write the trends that it is now part of into its folder.

    They are returned; None if there is no history, because no night was worth keeping yet. HistoryError or OSError if
    the file is no history, or cannot be written.

    Parameters
    ----------
    path : Path
        The history.
    report : mapping
        Of the night.
    folder : Path
        The night's.
    """
    append(path, report)
    if not path.is_file():
        return None
    known = trends(path)
    series = [one for one in known["series"] if one["nights"][-1] == known["nights"][-1]]
    course = {**known, "series": series[:MOST_TRENDS], "not_shown": max(0, len(series) - MOST_TRENDS)}
    replace_file(folder / TRENDS, json.dumps(course, indent=1) + "\n")
    return course


def refuse_other(path: Path) -> None:
    """Raise HistoryError if something else stands where a history is to be kept."""
    if path.exists():
        with _opened(path):
            pass


def append(path: Path, report: Mapping[str, Any]) -> bool:
    """Add a night to the history in a file; the same night once more, as after a resume, replaces itself.

    Return whether there was anything to keep: a night without scenes, or without a date, leaves no trace. HistoryError
    if the file is no history, or cannot be written.
    """
    if not report["scenes"] or not report["date"]:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    with _opened(path) as db, db:
        same = db.execute("SELECT id FROM night WHERE date = ? AND seed = ?", (report["date"], str(report["seed"])))
        for (night,) in same.fetchall():
            for table, key in (("accuracy", "night"), ("cost", "night"), ("night", "id")):
                db.execute(f"DELETE FROM {table} WHERE {key} = ?", (night,))
        keys = ("scenes", "configurations", "new_disagreements", "known_disagreements")
        numbers = [report[key] for key in keys]
        row = [report["date"], str(report["seed"]), report["verdict"], *numbers, json.dumps(report["versions"])]
        night = db.execute(
            "INSERT INTO night (date, seed, verdict, scenes, configurations, new, known, versions)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            row,
        ).lastrowid
        db.executemany("INSERT INTO accuracy VALUES (?, ?, ?, ?, ?, ?, ?, ?)", _accuracies(night, report))
        db.executemany("INSERT INTO cost VALUES (?, ?, ?, ?, ?)", _costs(night, report))
    return True


def _accuracies(night: int | None, report: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    keys = ("digits_median", "digits_p01", "digits_worst", "worst_over_allowed")
    for engine, methods in report["engines"].items():
        for method, quantities in methods.items():
            for quantity in QUANTITIES:
                yield (night, engine, method, quantity, *(quantities[quantity][key] for key in keys))


def _costs(night: int | None, report: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    """Yield the times of the night's methods and of its price list, each with its ratio to the reference's."""
    reference = report["reference"]["microseconds_mean"]
    for row in report["methods"]:
        if reference and row["microseconds_median"]:
            name = f"{row['engine']} · {row['method']}"
            yield night, name, row["microseconds_median"], row["microseconds_median"] / reference, False
    prices = report.get("price") or []
    own: dict[tuple[str, str], float] = {}
    for row in prices:
        what = (row["quantity"], row["scene_class"])
        if row["engine"].startswith(REFERENCE) and row["microseconds"]:
            own[what] = min(own.get(what, row["microseconds"]), row["microseconds"])
    for row in prices:
        what = (row["quantity"], row["scene_class"])
        if own.get(what) and row["microseconds"]:
            name = f"{row['engine']} · {row['method']}, {row['setting']}: {row['quantity']}, {row['scene_class']}"
            yield night, name, row["microseconds"], row["microseconds"] / own[what], True


def nights(path: Path) -> list[dict[str, Any]]:
    """Return the nights, oldest first, each with its versions and the worst digits of its methods."""
    keys = "id, date, seed, verdict, scenes, new, known, versions"
    with _opened(path, must_exist=True) as db:
        kept = [dict(row) for row in db.execute(f"SELECT {keys} FROM night ORDER BY date, id")]
        for night in kept:
            night["versions"] = json.loads(night["versions"])
            worst = db.execute(
                "SELECT engine, method, quantity, digits_median, digits_worst FROM accuracy WHERE night = ?",
                (night.pop("id"),),
            )
            night["accuracy"] = [dict(row) for row in worst]
        return kept


def trends(path: Path) -> dict[str, Any]:
    """Return {nights, series}: per series its nights, ratios to the reference, and {place of a change: its factor}.

    `priced` says whether it is one of the price list.
    """
    with _opened(path, must_exist=True) as db:
        dates = [date for (date,) in db.execute("SELECT date FROM night ORDER BY date, id")]
        rows = db.execute(
            "SELECT series, date, ratio, priced FROM cost JOIN night ON night.id = cost.night"
            " ORDER BY series, date, night.id"
        ).fetchall()
    series: dict[str, dict[str, Any]] = {}
    for name, date, ratio, priced in rows:
        one = series.setdefault(name, {"name": name, "priced": bool(priced), "nights": [], "values": []})
        one["nights"].append(date)
        one["values"].append(ratio)
    for one in series.values():
        one["changes"] = {str(k): factor for k, factor in change_points(one["values"]).items()}
    order = sorted(series.values(), key=lambda one: (not one["changes"], one["priced"], one["name"]))
    return {"nights": dates, "series": order}


def other_versions(kept: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line for whatever has another version in a night than it had in the last one that had it."""
    last: dict[str, Any] = {}
    lines = []
    for night in kept:
        changed = {name: version for name, version in night["versions"].items() if last.get(name, version) != version}
        lines += [f"{night['date']}: {name} {last[name]} became {version}" for name, version in changed.items()]
        last |= night["versions"]
    return lines


def warnings(course: Mapping[str, Any]) -> list[str]:
    """Return one line per change of level within the latest nights."""
    return [
        f"time of {one['name']}, relative to refkin: {'up' if factor > 1 else 'down'} by {factor:.2f} times"
        f" since {one['nights'][int(k)]}"
        for one in course["series"]
        for k, factor in one["changes"].items()
        if int(k) >= len(one["nights"]) - LATEST
    ]


@contextmanager
def _opened(path: Path, must_exist: bool = False) -> Iterator[sqlite3.Connection]:
    if must_exist and not path.is_file():
        raise HistoryError(f"there is no history {path}: crosscheck nightly makes one")
    if path.is_file():
        with path.open("rb") as file:
            begins = file.read(len(HEADER))
        if begins and begins != HEADER:  # SQLite takes a few bytes for an empty file, and writes over them
            raise HistoryError(f"{path}: file is not a database")
    try:
        with closing(sqlite3.connect(path, timeout=30.0)) as db:
            db.row_factory = sqlite3.Row
            tables = [name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
            if "night" not in tables and (tables or must_exist):
                raise HistoryError(f"{path}: expected a history of nights, got the tables {kept(str(tables))}")
            db.executescript(TABLES)
            _refuse_damaged(path, db)
            yield db
    except sqlite3.Error as error:
        raise HistoryError(f"{path}: {error}") from error


def _refuse_damaged(path: Path, db: sqlite3.Connection) -> None:
    """Raise HistoryError for the first row that no night has written: it would be shown, or taken for a time."""
    for table, sound in SOUND.items():
        for row in db.execute(f"SELECT rowid, * FROM {table} WHERE NOT ({sound}) LIMIT 1"):
            number, *values = tuple(row)
            raise HistoryError(f"{path}: row {number} of its table {table} is damaged: {kept(str(values))}")


FEWEST = 8
"""Nights below which nothing is said."""
SHORTEST = 4
"""Nights that a level must last to be one."""
SMALLEST = 0.05
"""Changes by less than this part of the level are not named."""
QUIET = 0.01
"""The least noise that is believed of a timer, as a part of what it measures."""
PER_CUT = 4.0


def change_points(values: Sequence[float]) -> dict[int, float]:
    """Return {first night of a new level: new level / old level} of positive numbers, one per night, oldest first."""
    n = len(values)
    if n < FEWEST:
        return {}
    logs = np.log(np.asarray(values, float))
    padded = np.pad(logs, 2, mode="reflect")
    smooth = np.median(np.stack([padded[k : k + n] for k in range(5)]), axis=0)
    # the standard deviation of normal noise, from the median of the differences of neighbours
    noise = max(QUIET, 1.4826 * float(np.median(np.abs(np.diff(logs)))) / math.sqrt(2.0))
    price = PER_CUT * math.log(n) * noise**2
    cuts = _partition(smooth, price)
    edges = [0, *cuts, n]
    levels = [float(np.median(smooth[a:b])) for a, b in pairwise(edges)]
    factors = {cut: math.exp(levels[k + 1] - levels[k]) for k, cut in enumerate(cuts)}
    return {cut: factor for cut, factor in factors.items() if abs(math.log(factor)) >= math.log1p(SMALLEST)}


def _partition(x: Any, price: float) -> list[int]:
    """Return the cuts of the cheapest partition into pieces of at least `SHORTEST` points."""
    n = len(x)
    first, second = (np.concatenate([[0.0], np.cumsum(x**power)]) for power in (1, 2))
    best = np.full(n + 1, np.inf)
    best[0] = -price
    before = np.zeros(n + 1, int)
    for end in range(SHORTEST, n + 1):
        for start in [0, *range(SHORTEST, end - SHORTEST + 1)]:
            total = first[end] - first[start]
            cost = best[start] + second[end] - second[start] - total**2 / (end - start) + price
            if cost < best[end]:
                best[end], before[end] = cost, start
    cuts = []
    at = int(before[n])
    while at > 0:
        cuts.append(at)
        at = int(before[at])
    return cuts[::-1]
