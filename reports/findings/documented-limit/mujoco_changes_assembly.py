"""MuJoCo: mj_step with its defaults, led to rest beside a limit position, comes to rest on the mirror assembly.

A four-bar with ground 4, crank 2, coupler 2.5, rocker 2 has two assemblies at every crank angle before the limit, where
coupler and rocker are stretched. On each of them the sign of the cross product of coupler and rocker stays what it is.
No warning is counted.

Class: documented limit. Documentation: "However MuJoCo constraints are soft, so in principle any configuration is
feasible." (MuJoCo 4.0.0 documentation, Modeling, Actuator length range (doc/modeling.rst)). Since: 4.0.0; 3.17.0
shows it, too.
"""

import math
import os
import sys

os.environ.setdefault("MUJOCO_GL", "disable")
import mujoco
import numpy as np

XML = """
<mujoco><compiler angle="radian" inertiafromgeom="false"/><option gravity="0 0 0"/>
<worldbody>
 <body><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="crank" axis="0 0 1"/>
  <body pos="2 0 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint axis="0 0 1"/>
   <site name="c" pos="2.5 0 0"/></body></body>
 <body pos="4 0 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint axis="0 0 1"/>
  <site name="r" pos="2 0 0"/></body>
</worldbody>
<equality><connect site1="c" site2="r"/><joint joint1="crank"/></equality></mujoco>
"""
LIMIT = math.acos((4**2 + 2**2 - 4.5**2) / 16)
BEFORE = (0.5, 0.2, 0.001, 0.1, 0.03)
START = (LIMIT - 0.5, -1.03, 1.99)


def main():
    print(f"mujoco {mujoco.__version__}")
    model = mujoco.MjModel.from_xml_string(XML)
    q = np.array(START)
    sides = []
    for way in BEFORE:
        model.eq_data[1, 0] = LIMIT - way
        data = mujoco.MjData(model)
        data.qpos[:] = q
        for _ in range(20_000):
            mujoco.mj_step(model, data)
            if np.max(np.abs(data.qvel)) < 1e-9:
                break
        q = np.array(data.qpos)
        gap = np.linalg.norm(data.site_xpos[0] - data.site_xpos[1])
        rests = gap < 1e-6 and np.max(np.abs(data.qvel)) < 1e-9 and not any(w.number for w in data.warning)
        side = math.sin(q[2] - q[0] - q[1])
        print(f"{way} rad before the limit: at rest without a warning {rests}, sine of coupler to rocker {side:+.4f}")
        sides += [side] if rests else []
    shown = min(sides) < 0 < max(sides)
    print("expected: one sign throughout, or a warning")
    print("came:     both signs" if shown else "came:     what was expected")
    return 0 if shown else 1


if __name__ == "__main__":
    sys.exit(main())
