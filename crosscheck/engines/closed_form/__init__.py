"""Planar linkages in closed form, group by group (Assur), in floats or in balls: the arbiter of formulas.

Nothing here is shared with `refkin` but the data of a scene: no residual, no Jacobian, no iteration. Reading order:

`jets`       value, rate and acceleration of a number (Taylor arithmetic in time), in float rows or `flint.arb` balls;
             whole turns of an angle between far times
`laws`       the laws of the drivers as jets
`linkage`    bodies that are rigid against each other, the rows and links between them, and where two of those meet
`assemble`   the four deductions that join them until every body is on the ground; which assembly
`solution`   a scene solved in one arithmetic, with a check that every joint is closed
"""
