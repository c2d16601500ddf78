"""Compares exudyn, Pinocchio and MuJoCo with the reference: how many digits each can be trusted for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = ["compare"]


def compare(
    scene: Any, engines: Sequence[str] = ("exudyn", "pinocchio", "mujoco"), show: bool = True
) -> dict[str, Any]:
    """Solve a scene with the reference and with engines, print how they agree, and return it.

    Parameters
    ----------
    scene : refkin.Scene
    engines : sequence of str
        Names as `crosscheck engines` lists them; each must be installed.
    show : bool
        Print the table.

    Returns
    -------
    dict
        The `crosscheck.judge.records.Record` of the scene as plain data: what a line of `records.jsonl` holds.
    """
    from crosscheck.commands.tables import agreement_table
    from crosscheck.commands.usage import console
    from crosscheck.judge.records import plain
    from crosscheck.measure.check import check

    record = check(scene, engines)
    if show:
        out = console(140)
        out.print(agreement_table(record))
        for disagreement in record.disagreements:
            out.print(str(disagreement))
    return plain(record)
