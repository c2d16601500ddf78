"""The scenes that the tests of this folder run on, every joint type among them; not a test itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import refkin
from refkin import FourBar, InvertedSliderCrank, SliderCrank

from .. import contact_cases  # noqa: TID252 (a folder of tests is no package that has a name)
from .linkworks import chain, platform

ROCKER = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
TIMES = tuple(np.linspace(0.0, 2.0, 41).tolist())


def bare(scene, **changes):
    """The scene without evidence."""
    return replace(scene, evidence=frozenset(), **changes)


def by_name():
    """Scenes by name: those with a closed form, linkages, and large groups."""
    found = {name: contact_cases.scene(name) for name in contact_cases.CASES}
    found = {name: replace(scene, times=TIMES) for name, scene in found.items()}
    found["four-bar"] = ROCKER.scene(samples=101)
    found["coupler driven"] = ROCKER.scene(samples=50, start=0.6, turns=0.05, driven="coupler")
    found["slider-crank"] = SliderCrank(crank=1.0, rod=3.0, offset=0.4).scene(samples=101)
    found["inverted slider-crank"] = InvertedSliderCrank(ground=2.0, crank=1.0, offset=0.3).scene(samples=101)
    found["platform"] = platform()
    found["chain"] = chain(3)
    found["chain at once"] = chain(2, together=True)
    found["long chain at once"] = chain(5, together=True)
    return {name: bare(scene) for name, scene in found.items()}


SCENES = by_name()


def system_of(scene):
    """The system of a scene in its own unit, with all effects."""
    return refkin.compile_system(scene.mechanism, unit=scene.mechanism.unit())
