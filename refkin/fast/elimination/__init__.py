"""The compiled elimination program, in four steps; and a certificate, which is one more program.

============= ========= =============================================================================================
tracing       symbols   expressions, each once, folded
              trace     the joints' formulas run on symbols
elimination   blocks    how an Assur group is solved
              eliminate coordinates that a row states outright, then the groups: expressions of the solution
scheduling    schedule  from expressions to instructions and registers
              program   the result, its text for a person, and one sample at a time in Python
running       run       on rows, by NumPy
proving       prove     that exactly one solution is near given numbers, and how near
============= ========= =============================================================================================
"""
