"""Checks of what stands behind an answer: proofs hold the truth, budgets see errors, documents are read rightly."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from flint import ctx

from crosscheck.documents.ledger.rows import Printed, Written, correct_digits, printed_is
from crosscheck.judge.comparison import compare, reference
from crosscheck.judge.samples import largest_ratio
from refkin.model import Scene
from refkin.motion_laws import Polynomial
from refkin.proof.pose.krawczyk import krawczyk
from refkin.scenes.linkages import FourBar, SliderCrank
from refkin.solving.solve import nearest, solve
from refkin.system import compile_system
from tests.claims import U

LAW = Polynomial(coefficients=(0.4, 1.3, -0.7))
TIMES = (0.0, 0.6, 1.1)


def scenes() -> list[Scene]:
    """Return a four-bar and a slider-crank, driven with speed and acceleration."""
    linkages = (FourBar(4.0, 1.0, 3.5, 3.0), SliderCrank(1.0, 3.0, 0.4))
    return [linkage.scene(law=LAW, times=TIMES) for linkage in linkages]


def test_certified_radii_hold_the_truth():
    """The truth, enclosed to 200 bits, lies within the certified radius, which is not a thousand times too wide."""
    for scene, solving in product(scenes(), (solve, nearest)):
        motion = solving(scene)
        system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
        radius, own = motion.certified_radius, [system.to_unit(x, k) for k, x in enumerate(motion.levels)]
        for k, t in enumerate(scene.times):
            truth = krawczyk(system, own[0][:, k], t, bits=200)
            assert truth is not None, f"{scene.name}: no enclosure at {t}"
            if truth is None:
                continue
            levels = (truth.q, qd := truth.velocity(), truth.acceleration(qd))
            radii = (radius.position[k], radius.velocity[k], radius.acceleration[k])
            for answer, balls, allowed in zip(own, levels, radii, strict=True):
                off = float(np.max(truth.distance(answer[:, k], balls)))
                assert off <= allowed, f"{scene.name} at {t}: off by {off}, certified {allowed}"
                assert allowed <= 1e4 * 2 * U * max(1.0, np.max(np.abs(answer[:, k]))), (
                    f"{scene.name}: radius {allowed}"
                )


def test_planted_errors_are_seen():
    """An answer that is off by 1e-9 in any one coordinate, at any level, disagrees; the reference's own agrees."""
    for scene in scenes():
        ref = reference(scene)
        assert compare(ref, ref.motion).agrees, f"{scene.name}: disagrees with itself"
        for level in ("q", "qd", "qdd"):
            for row in range(len(ref.motion.q)):
                wrong = np.array(getattr(ref.motion, level))
                wrong[row, 1] += 1e-9
                changed: dict[str, Any] = {level: wrong}
                motion = replace(ref.motion, **changed)
                assert not compare(ref, motion).agrees, f"{scene.name}: {level}[{row}] off by 1e-9 agrees"


def test_printed_digits_are_counted():
    """A printed number is right if it is correctly rounded, cut off if it is the truth's beginning, else wrong."""
    for text, truth, kind, digits in (
        ("3.5838", "3.58375", Printed.RIGHT, 5.0),
        ("3.5838", "3.583853", Printed.TRUNCATED, 4.8),
        ("2.7109", "2.701942", Printed.WRONG, 2.4),
        ("-0.2968", "0.296846", Printed.WRONG, 0.0),
        ("0.3812", "0.38125", Printed.RIGHT, 4.0),
        ("0.3813", "0.38125", Printed.RIGHT, 4.0),
        ("0.0", "-0.1", Printed.WRONG, 0.0),
        ("1e-14", "4.8563e-10", Printed.WRONG, 0.0),
    ):
        with ctx.workprec(256):
            number, true = Written.read(text), Written.read(truth).value
            assert printed_is(number, true) is kind, f"{text} for {truth} is {printed_is(number, true)}"
            result = correct_digits(number, true)
        assert result == digits, f"{text} for {truth}: {result} digits, not {digits}"


def test_the_largest_ratio_is_reported():
    assert largest_ratio(np.array([0.1, 7.0, np.nan, 3.0])) == 7.0
    assert largest_ratio(np.array([np.inf, 1.0])) == sys.float_info.max
    assert largest_ratio(np.array([np.nan])) is None
