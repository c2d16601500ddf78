"""What a night measures beside its scenes, for the report: hard cases, prices, effects, and the source documents.

Each is a file of plain rows in the night's folder (`report.measured` reads them). They are measured when the scenes are
done, one after the other, so that nothing else disturbs their timings.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from crosscheck.documents.page import digits_by_iteration, documents, newton_histories, slopes
from crosscheck.engines.methods import OURS, PRICED
from crosscheck.measure.effects_ablations import REFKIN
from crosscheck.measure.effects_ledger import effects_ledger
from crosscheck.measure.hard_table import hard_case_rows
from crosscheck.measure.price import LEAST, price_list
from crosscheck.night.journal import replace_file
from crosscheck.scenes.priced import classes
from refkin.model import Point, Scene

HARD, PRICE, EFFECTS = 0.25, 0.5, 0.25
"""How the time is shared."""
PRICED_CLASS = "regular"
"""The class of the price list whose scene the ledger of effects is about."""


def write_sections(
    folder: Path,
    engines: Mapping[str, str],
    left_out: Collection[str],
    seconds: float,
    tell: Callable[[str], None] = lambda doing: None,
) -> None:
    """Write hard_cases.json, price.json and effects.json, as far as engines get in some time.

    Parameters
    ----------
    folder : Path
        The folder of the run.
    engines : mapping
        Name -> what `crosscheck.engines.load` takes for it.
    left_out : collection of str
        Names of those that are not asked.
    seconds : float
        How long it may take in all, beside the start of processes. Nothing is written where the price list cannot keep
        to its share, since it gives each class of scenes its least.
    tell : callable
        Is told what is being measured.
    """
    if not PRICE * seconds >= LEAST * len(classes()):
        return
    named = [spec for name, spec in engines.items() if name not in left_out]
    measures: dict[str, tuple[str, Callable[[], Sequence[Any]]]] = {
        "hard_cases": ("hard cases", lambda: hard_case_rows([REFKIN, *named], HARD * seconds)),
        "price": ("the price list", lambda: price_list(PRICE * seconds, _producers(named))),
        "effects": ("the ledger of effects", lambda: _effects(named, EFFECTS * seconds)),
    }
    for name, (doing, measure) in measures.items():
        tell(doing)
        replace_file(folder / f"{name}.json", json.dumps(measure(), indent=1, allow_nan=False) + "\n")


def write_documents(folder: Path) -> None:
    """Write documents.json: the source documents recomputed, and the experiments on convergence that they describe."""
    recomputed = {
        "newton_histories": newton_histories(),
        "slopes": slopes(),
        "documents": documents(),
        "iterations": digits_by_iteration(),
    }
    replace_file(folder / "documents.json", json.dumps(recomputed, indent=1, allow_nan=False) + "\n")


def _producers(engines: Sequence[str]) -> tuple[str, ...]:
    """Return who is priced: whoever is no engine, and the engines of the night."""
    return (*(name for name in PRICED if name in OURS), *engines)


def _effects(engines: Sequence[str], seconds: float) -> list[dict[str, Any]]:
    return [asdict(row) for row in effects_ledger(_with_a_point(classes()[PRICED_CLASS]), engines, seconds)]


def _with_a_point(scene: Scene) -> Scene:
    """Return the scene with a point whose motion is wanted, so that points have a price as well."""
    return replace(scene, points=(Point(name="P", body=scene.mechanism.bodies[0].name, position=(0.3, 0.2)),))
