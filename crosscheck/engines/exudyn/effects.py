"""What exudyn simulates beside kinematics, added to a system one by one, to see who feels it.

exudyn simulates what is added and nothing else. Forces are in the model's own units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import exudyn as exu
from exudyn import itemInterface as item

from crosscheck.engines import Switch
from crosscheck.engines.exudyn.parts import Builder
from refkin.joints import GROUND

MASS = 7.0


def _bodies(b: Builder) -> Iterator[tuple[str, Any]]:
    return ((name, number) for name, number in b.bodies.items() if name != GROUND)


def _inertia(b: Builder) -> None:
    for _, number in _bodies(b):
        b.mbs.SetObjectParameter(number, "mass", MASS)
        b.mbs.SetObjectParameter(number, "inertia", MASS)


def _gravity(b: Builder) -> None:
    _inertia(b)
    for _, number in _bodies(b):
        weight = b.mbs.AddMarker(item.MarkerBodyMass(bodyNumber=number))
        b.mbs.AddLoad(item.LoadMassProportional(markerNumber=weight, loadVector=[0.0, -9.81, 0.0]))


def _on_angles(kind: Any, start: Sequence[float] = (), **numbers: Any) -> Callable[[Builder], None]:
    """Return what adds a force between the angle of each body and the ground, with data of its own that start so."""

    def add(b: Builder) -> None:
        for name, _ in _bodies(b):
            data = item.NodeGenericData(initialCoordinates=list(start), numberOfDataCoordinates=len(start))
            state = {"nodeNumber": b.mbs.AddNode(data)} if start else {}
            b.mbs.AddObject(kind(markerNumbers=[b.still, b.angle(name)], **state, **numbers))

    return add


def _actuation(b: Builder) -> None:
    for name, _ in _bodies(b):
        b.mbs.AddLoad(item.LoadCoordinate(markerNumber=b.angle(name), load=10.0))


def _sensors(b: Builder) -> None:
    for _, number in _bodies(b):
        what = {"outputVariableType": exu.OutputVariableType.Position, "storeInternal": True, "writeToFile": False}
        b.mbs.AddSensor(item.SensorBody(bodyNumber=number, **what))


STOPS = {"useLimitStops": True, "limitStopsLower": -1e-3, "limitStopsUpper": 1e-3, "limitStopsStiffness": 10.0}
"""They are hit from the start: exudyn finds out after a step only, and Newton alone makes none."""
EFFECTS = {
    "gravity": Switch(f"masses of {MASS:g} and 9.81 down the y axis", _gravity),
    "contact": Switch(
        "the angle of each body pressed against a stop of stiffness 1",
        _on_angles(item.ObjectContactCoordinate, [0.0], contactStiffness=1.0, offset=10.0),
    ),
    "friction": Switch(
        "a friction torque of 1 on each body",
        _on_angles(item.CoordinateSpringDamperExt, dynamicFrictionForce=1.0, frictionProportionalZone=1e-3),
    ),
    "joint limits": Switch(
        "stops of stiffness 10 at angles of 1e-3", _on_angles(item.CoordinateSpringDamperExt, [0.0, 0.0, 1.0], **STOPS)
    ),
    "passive forces": Switch(
        "stiffness 10 and damping 1 on each body's angle",
        _on_angles(item.CoordinateSpringDamper, stiffness=10.0, damping=1.0),
    ),
    "actuation": Switch("a torque of 10 on each body", _actuation),
    "sensors": Switch("a sensor of position on each body, stored", _sensors),
    "inertia": Switch(f"masses and inertias of {MASS:g}", _inertia),
}
