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
        The record of `crosscheck.measure.check.check`: answers, comparison of the engines' own rows, disagreements.
    """
    from rich.console import Console

    from crosscheck.commands.tables import agreement_table, disagreement_lines
    from crosscheck.measure.check import check

    record = check(scene, engines)
    if show:
        console = Console(width=140, markup=False)
        console.print(agreement_table(record))
        for line in disagreement_lines(record["disagreements"]):
            console.print(line)
    return record
