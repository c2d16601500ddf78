"""Compares exudyn, Pinocchio and MuJoCo with the reference: how many digits each can be trusted for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from crosscheck.judge.agreement import assert_agrees

__all__ = ["assert_agrees", "compare"]


def compare(scene: Any, engines: Sequence[str] | None = None, show: bool = True) -> dict[str, Any]:
    """Solve a scene with the reference and with engines, print how they agree, and return it.

    Parameters
    ----------
    scene : refkin.Scene
    engines : sequence of str, optional
        Names as `crosscheck engines` lists them; each must be installed. By default exudyn, Pinocchio and MuJoCo.
    show : bool
        Print the table.

    Returns
    -------
    dict
        The `crosscheck.judge.records.Record` of the scene as plain data: what a line of `records.jsonl` holds.
    """
    from crosscheck.commands.engines import agreement_table
    from crosscheck.commands.usage import console
    from crosscheck.judge.records import plain
    from crosscheck.measure.check import check
    from crosscheck.scenes.names import PEERS
    from refkin.errors import expect
    from refkin.joints.annotations import check as well_formed
    from refkin.joints.annotations import is_flag
    from refkin.model import Scene

    expect("scene", scene, Scene)
    expect("engines", engines, list, tuple, type(None))
    for engine in engines or ():
        expect("engines", engine, str)
    well_formed("show", "True or False", show, is_flag(show))
    record = check(scene, PEERS if engines is None else engines)
    if show:
        out = console(140)
        out.print(agreement_table(record, out.width))
        for disagreement in record.disagreements:
            out.print(str(disagreement))
    return plain(record)


def __getattr__(name: str) -> Any:
    if name != "assert_agrees":
        raise AttributeError(f"module 'crosscheck' has no attribute {name!r}")
    from crosscheck.judge.agreement import assert_agrees

    return assert_agrees
