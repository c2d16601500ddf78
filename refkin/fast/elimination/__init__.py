"""The compiled elimination program, in four steps; and a certificate, which is one more program.

============= ========= =============================================================================================
tracing       symbols   expressions, each once, folded
              trace     the joints' formulas run on symbols
elimination   blocks    how an Assur group is solved
              eliminate coordinates that a row states outright, then the groups: expressions of the solution
scheduling    schedule  from expressions to instructions and registers
              program   the result, and its text for a person
running       run       on rows, by NumPy
              single    one sample at a time, in Python
proving       prove     that exactly one solution is near given numbers, and how near
============= ========= =============================================================================================
"""
