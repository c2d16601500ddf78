"""The problem set: fixed mechanisms with answers proved to 30 digits, for whoever writes a solver.

`planar` and `spatial` say which mechanisms there are, `statement` which assembly is meant, and proves the answers;
`mjcf` and `exudyn_script` write them for two engines, `export` puts it all into a folder, with `grader`, which needs
nothing but Python, beside it.
"""

VERSION = "1"
"""Of the set; whoever changes a problem or an answer gives it another."""
SHA256 = "3644ccbda9b6e06285cfe2ff0bc896c0e99577eef95a60a213bf1be2c37b8f18"
"""The hash of the whole set of that version."""
