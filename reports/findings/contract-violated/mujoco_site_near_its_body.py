"""MuJoCo: a site less than 1e-6 from the origin of its body is put at the origin, without a word.

A body of a micromechanism, in metres, with a site half a micrometre from its origin. The compiler takes positions that
differ by less than 1e-6 for one (kFrameEps in src/user/user_model.cc), whatever the unit of length and the size of the
model; mj_kinematics then copies the body's position.

Class: contract violated. Documentation: "Position of the site frame." (MuJoCo 4.0.0 documentation, XML reference,
body/site/pos (doc/XMLreference.rst)). Since: 4.0.0; 3.17.0 shows it, too, and the comparison stands in the source
since it is open (2022, read).
"""

import os
import sys

os.environ.setdefault("MUJOCO_GL", "disable")
import mujoco

XML = """
<mujoco><worldbody>
 <body name="link"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint axis="0 0 1"/>
  <site name="pin" pos="{place!r} 0 0"/></body>
</worldbody></mujoco>
"""
PLACES = (5e-7, 9.9e-7, 1.01e-6)


def main():
    print(f"mujoco {mujoco.__version__}")
    wrong = 0
    for place in PLACES:
        model = mujoco.MjModel.from_xml_string(XML.format(place=place))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        came = data.site("pin").xpos[0]
        print(f"expected: the site at x = {place:g}; came: {came:g}")
        wrong += came != place
    return 0 if wrong else 1


if __name__ == "__main__":
    sys.exit(main())
