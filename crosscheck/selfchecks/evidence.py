"""Checks of what stands behind an answer: proofs hold the truth, budgets see errors, documents are read rightly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from flint import ctx

from crosscheck.documents.ledger.digits import Printed, Written, correct_digits, printed_is
from crosscheck.documents.systems import SquareSystem, me451, me581, metu, shabana, twelve_coordinates
from crosscheck.judge.comparison import compare, reference
from crosscheck.measure.check import check as check_scene
from crosscheck.selfchecks.claims import U, check, demand, demand_near
from refkin.differences import Scheme, jacobian
from refkin.joints import GROUND, AngleDriver, Gear, Prismatic, RackAndPinion, Revolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.proof.pose.krawczyk import refine
from refkin.scenes.linkages import FourBar, SliderCrank
from refkin.system import compile_system

LAW = Polynomial(coefficients=(0.4, 1.3, -0.7))
TIMES = (0.0, 0.6, 1.1)


def scenes() -> list[Scene]:
    """Return a four-bar and a slider-crank, driven with speed and acceleration."""
    linkages = (FourBar(4.0, 1.0, 3.5, 3.0), SliderCrank(1.0, 3.0, 0.4))
    return [linkage.scene(law=LAW, times=TIMES) for linkage in linkages]


def geared() -> Scene:
    """Return a wheel that turns another, which rolls a third along a rack: rows that are no loops."""
    origin = (0.0, 0.0)
    wheels = tuple(
        Revolute(name=f"axle {name}", body_i=GROUND, point_i=at, body_j=name, point_j=origin)
        for name, at in (("i", origin), ("j", (1.0, 0.0)))
    )
    mesh = Gear(name="mesh", body_i="i", radius_i=0.4, body_j="j", radius_j=0.6, phi0_i=0.1)
    guide = Prismatic(name="guide", body_i=GROUND, point_i=(0.0, 0.6), axis_i=(1.0, 0.0), body_j="rack", point_j=origin)
    teeth = RackAndPinion(
        name="teeth", body_i="rack", point_i=origin, axis_i=(1.0, 0.0), body_j="j", point_j=origin, radius=0.6, s0=0.7
    )
    drive = AngleDriver(name="drive", body="i", law=LAW)
    estimates = (("i", (0.0, 0.0, 0.4)), ("j", (1.0, 0.0, -0.2)), ("rack", (0.2, 0.6, 0.0)))
    bodies = tuple(Body(name=name, estimate=at) for name, at in estimates)
    return Scene(mechanism=Mechanism(bodies, (*wheels, mesh, guide, teeth), (drive,)), times=TIMES, name="geared")


def square_systems() -> list[tuple[str, SquareSystem, Any]]:
    """Return the systems of the documents, each with a place at which nothing vanishes."""
    bar = me581.FourBarLengths(90.0, 30.0, 60.0, 45.0, 0.3)
    slotted = metu.Slotted(0.3, 0.25, 0.9, 0.6, -0.5, 0.4, 0.7)
    drive = metu.Rapier(-6.0, -3.0, -5.0, -2.5, -6.0, 2.5, 12.0, 3.5, 6.0, 11.0)
    coordinates = np.linspace(-0.7, 1.3, 12)
    return [
        ("A1", me451.root_minus_sine(), [0.7]),
        ("A2", me451.sine_and_exponential(), [0.8, 1.3]),
        ("A3", me451.square_and_sine(1.841471), [1.4]),
        ("A4", me451.exponential_and_logarithm(), [0.7, 0.3]),
        ("A6", me451.problem_356(0.43, 0.6, 0.25), [0.3, 0.2, 0.9]),
        ("A8", me451.problem_356_fold(0.6, 0.25), [0.3, 0.2, 0.9, 0.43, 0.6, -0.7, 1.1]),
        ("A9", me451.even_function(0.6), [0.7]),
        ("A10", me451.square(4.0), [1.3]),
        ("B2", metu.slotted(slotted), [1.2, 0.4, 0.5, 1.1]),
        ("B5", metu.rapier(drive, 0.7), [3.1, 1.2, 2.9, 4.0]),
        ("B5 fold", metu.rapier_fold(drive), [3.1, 1.2, 2.9, 4.0, 0.7, 0.3, -0.6, 0.8, 1.4]),
        ("C1", me581.quadratic(), [5.0]),
        ("C4", me581.four_bar(bar, 1.1), [0.2, 1.9]),
        ("C6", me581.four_bar_by_rocker(bar, 1.1), [0.2, 1.9]),
        ("D4", shabana.slider_crank(0.2, 0.35, 0.1, 1.1), [-0.3, 0.4]),
        ("D7", shabana.coriolis_example(0.5, 0.2, 1.1), [2.7, 0.4]),
        ("D10", shabana.four_bar(0.35, 0.2, 0.35, 0.25, 1.1), [1.1, 0.2, 4.3]),
        ("D15", twelve_coordinates.twelve_coordinates(0.2, 0.35, 1.1), coordinates),
        ("D16", twelve_coordinates.twelve_coordinates(0.2, 0.35, 0.4, twelve_coordinates.SLIDER_DRIVEN), coordinates),
    ]


@check
def document_jacobians_are_the_derivatives() -> None:
    """phi_q of every system of the documents is the complex-step derivative of its phi."""
    for name, system, at in square_systems():
        q = np.asarray(at, float)
        exact = jacobian(system.phi, q, Scheme.COMPLEX_STEP)
        demand_near(np.asarray(system.phi_q(q), float), exact, 256 * U * max(1.0, np.max(np.abs(exact))), name)


@check
def certified_radii_hold_the_truth() -> None:
    """The truth, enclosed to 200 bits, lies within the certified radius, which is not a thousand times too wide."""
    for scene in scenes():
        ref = reference(scene)
        system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
        radius = ref.motion.certified_radius
        for k, t in enumerate(scene.times):
            truth = refine(system, ref.levels[0][:, k], t)
            demand(truth is not None, f"{scene.name}: no enclosure at {t}")
            if truth is None:
                continue
            levels = (truth.q, truth.velocity(), truth.acceleration())
            radii = (radius.position[k], radius.velocity[k], radius.acceleration[k])
            for answer, balls, allowed in zip(ref.levels, levels, radii, strict=True):
                off = float(np.max(truth.distance(answer[:, k], balls)))
                demand(off <= allowed, f"{scene.name} at {t}: off by {off}, certified {allowed}")
                demand(
                    allowed <= 1e4 * 2 * U * max(1.0, np.max(np.abs(answer[:, k]))), f"{scene.name}: radius {allowed}"
                )


@check
def planted_errors_are_seen() -> None:
    """An answer that is off by 1e-9 in any one coordinate, at any level, disagrees; the reference's own agrees."""
    for scene in scenes():
        ref = reference(scene)
        demand(compare(ref, ref.motion).agrees, f"{scene.name}: disagrees with itself")
        for level in ("q", "qd", "qdd"):
            for row in range(len(ref.motion.q)):
                wrong = np.array(getattr(ref.motion, level))
                wrong[row, 1] += 1e-9
                changed: dict[str, Any] = {level: wrong}
                motion = replace(ref.motion, **changed)
                demand(not compare(ref, motion).agrees, f"{scene.name}: {level}[{row}] off by 1e-9 agrees")


@check
def formulations_agree_on_scenes() -> None:
    """Closed form and vector loops, which share nothing with refkin, agree with it on fixed scenes."""
    for scene, engines in (
        *((scene, ["closed_form", "vector_loop"]) for scene in scenes()),
        (geared(), ["vector_loop"]),
    ):
        record = check_scene(scene, engines)
        demand(not record["disagreements"], f"{scene.name}: {record['disagreements']}")
        demand(len(record["answers"]) == len(engines), f"{scene.name}: {record['refusals']}")


@check
def printed_digits_are_counted() -> None:
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
            demand(printed_is(number, true) is kind, f"{text} for {truth} is {printed_is(number, true)}")
            found = correct_digits(number, true)
        demand(found == digits, f"{text} for {truth}: {found} digits, not {digits}")
