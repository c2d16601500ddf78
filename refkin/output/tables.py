"""A motion as a table, with one row per time or one per number; headers name what stands below, with its unit."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from refkin.errors import InvalidRequest, RefkinError, expect
from refkin.motion import QUANTITIES

UNITS = {
    "planar": (("m", "m", "rad"), ("m/s", "m/s", "rad/s"), ("m/s^2", "m/s^2", "rad/s^2")),
    "spatial": tuple(("m" + per,) * 3 + (unit,) * 4 for per, unit in (("", "1"), ("/s", "1/s"), ("/s^2", "1/s^2"))),
}


class MissingPackage(RefkinError, ImportError):
    """An optional package that is not installed; says which extra brings it."""


def columns(motion: Any) -> Iterator[tuple[str, str, str, str, Any]]:
    """Yield what, quantity, level, unit and values (T,) of each column of a Motion or Path beyond time and status.

    What is a body, a point or a cam, in the order of the motion; levels that were not called for have no columns.
    """
    names, units, width = motion.kind.coordinates, UNITS[motion.kind.name], motion.kind.width
    for level, rows in enumerate(motion.levels):
        if rows is not None:
            for k, values in enumerate(rows):
                own = k % width
                yield motion.bodies[k // width], names[own] + "d" * level, QUANTITIES[level], units[level][own], values
    for name, point in motion.points.items():
        for level, parts in enumerate((point.r, point.v, point.a)):
            if parts is not None:
                for axis, values in enumerate(parts):
                    yield name, names[axis] + "d" * level, QUANTITIES[level], units[level][axis], values
    for name, contact in motion.contacts.items():
        for level, values in enumerate((contact.s, contact.sd, contact.sdd)):
            if values is not None:
                yield name, ("s", "sd", "sdd")[level], QUANTITIES[level], UNITS["planar"][level][2], values


def wide(motion: Any) -> dict[str, Any]:
    """Return header -> column: time and status (`first_columns`), then `body.x [m]` and so on, each (T,)."""
    return {**motion.first_columns, **{f"{what}.{name} [{unit}]": x for what, name, _, unit, x in columns(motion)}}


def long(motion: Any) -> dict[str, Any]:
    """Return header -> column with one row per number: time, status, name, quantity, level, unit, value."""
    listed = list(columns(motion))
    count = len(motion.t)
    keys = ("name", "quantity", "level", "unit")
    texts = {key: np.repeat([column[k] for column in listed], count) for k, key in enumerate(keys)}
    first = {key: np.tile(values, len(listed)) for key, values in motion.first_columns.items()}
    return {**first, **texts, "value": np.concatenate([column[4] for column in listed])}


class Tabled:
    """What has times, bodies and levels, as tables and in files.

    Attributes
    ----------
    first_columns : mapping
        Header -> the columns that a row begins with, (T,) each.
    """

    t: Any
    status: Any

    @property
    def first_columns(self) -> Mapping[str, Any]:
        return {"t [s]": self.t, "status": np.array([str(status) for status in self.status])}

    def to_dataframe(self, form: str = "wide") -> Any:
        """Return a pandas data frame; headers name the units.

        Parameters
        ----------
        form : {"wide", "long"}
            One row per time with columns like `rocker.phi [rad]`, or one row per number with its name, quantity, level
            and unit.

        Raises
        ------
        MissingPackage
            If pandas is not installed.
        """
        tables = {"wide": wide, "long": long}
        if not (isinstance(form, str) and form in tables):
            raise InvalidRequest("form", " or ".join(map(repr, tables)), repr(form))
        try:
            import pandas
        except ImportError as error:
            raise MissingPackage(f"a data frame takes pandas: pip install 'refkin[tables]' ({error})") from error
        return pandas.DataFrame(tables[form](self))

    def to_csv(self, file: str | Path) -> None:
        """Write the wide table; every number with the digits that give it back exactly, nothing where there is none."""
        expect("file", file, str, PathLike)  # a number would be a file that is open, such as that of `print`
        table = wide(self)
        with open(file, "w", newline="", encoding="utf-8") as out:
            writer = csv.writer(out)
            writer.writerow(table)
            writer.writerows([_cell(x) for x in row] for row in zip(*table.values(), strict=True))

    def to_npz(self, file: str | Path) -> None:
        """Write the columns of the wide table as arrays, each under its header; `numpy.load` reads them back."""
        np.savez(file, **wide(self))


def _cell(x: Any) -> str:
    if isinstance(x, str):
        return str(x)
    return repr(float(x)) if np.isfinite(x) else ""
