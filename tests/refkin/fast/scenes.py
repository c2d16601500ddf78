"""The scenes that the tests of this folder run on, every joint type among them; not a test itself."""

from __future__ import annotations

import cmath
from dataclasses import replace

import numpy as np

from refkin import Body, Fixed, InvertedSliderCrank, Sinusoid, SliderCrank, YDriver
from tests.linkages import ROCKER, remade

from .. import contact_cases
from .linkworks import chain, platform

TIMES = tuple(np.linspace(0.0, 2.0, 41).tolist())


def bare(scene, **changes):
    """The scene without evidence."""
    return replace(scene, evidence=frozenset(), **changes)


def by_name():
    """Scenes by name: those with a closed form, linkages, and large groups."""
    values = {name: contact_cases.scene(name) for name in contact_cases.CASES}
    values = {name: replace(scene, times=TIMES) for name, scene in values.items()}
    values["four-bar"] = ROCKER.scene(samples=101)
    values["coupler driven"] = ROCKER.scene(samples=50, start=0.6, turns=0.05, driven="coupler")
    values["slider-crank"] = SliderCrank(crank=1.0, rod=3.0, offset=0.4).scene(samples=101)
    values["inverted slider-crank"] = InvertedSliderCrank(ground=2.0, crank=1.0, offset=0.3).scene(samples=101)
    values["crank by its height"] = lifted()
    values["flag on the coupler"] = flagged()
    values["platform"] = platform()
    values["chain"] = chain(3)
    values["chain at once"] = chain(2, together=True)
    values["long chain at once"] = chain(5, together=True)
    return {name: bare(scene) for name, scene in values.items()}


def lifted():
    """The four-bar with the height of its crank's tip given."""
    scene = ROCKER.scene(start=0.3, turns=0.05, samples=20)
    law = Sinusoid(amplitude=1.0, angular_frequency=0.2, phase=0.3)
    driver = YDriver(name="lift", body="crank", point=(0.5, 0.0), law=law)
    return remade(scene, drivers=(driver,))


def flagged():
    """The four-bar with a flag welded to its coupler."""
    scene = ROCKER.scene(samples=50)
    x, y, phi = next(b.estimate for b in scene.mechanism.bodies if b.name == "coupler")
    z = complex(x, y) + cmath.rect(1.0, phi) * (0.3 + 0.2j) - cmath.rect(1.0, phi + 0.4) * 0.1
    flag = Body(name="flag", estimate=(z.real, z.imag, phi + 0.4))
    weld = Fixed(name="weld", body_i="coupler", point_i=(0.3, 0.2), body_j="flag", point_j=(0.1, 0.0), angle=0.4)
    m = scene.mechanism
    return remade(scene, bodies=(*m.bodies, flag), joints=(*m.joints, weld))


SCENES = by_name()
