"""What the engines do where it is hard: the same scenes through every route, each answer classed by certificates.

`hard_cases` are the scenes, `hard_case_rows` the table; `findings.toml` says what is known of answers that are wrong.
"""

from crosscheck.hard_cases.cases import HardCase, hard_cases
from crosscheck.hard_cases.judging import Outcome
from crosscheck.hard_cases.table import hard_case_rows

__all__ = ["HardCase", "Outcome", "hard_case_rows", "hard_cases"]
