"""What proofs and solvers say, asked piece by piece (`proof_questions`, `solving_questions`), is what it was.

As with `test_answers`, whoever means a change makes the file anew, and says what changed: `python -m
tests.refkin.test_proofs` asks again what is kept; what is to be kept, too, is named, as `question: scene`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tests.kept import differences, on_every_processor, plain, read, write
from tests.refkin.proof_scenes import scenes
from tests.refkin.solving_questions import answer

FILE = Path(__file__).with_name("proofs.json")
KEPT = read(FILE)
SCENES = scenes()


def said(name: str) -> object:
    question, _, scene = name.partition(": ")
    return plain(answer(question, SCENES[scene]()))


@pytest.mark.parametrize("name", KEPT)
def test_an_answer_is_what_it_was(name: str) -> None:
    assert sorted(differences(said(name), KEPT[name])) == []


if __name__ == "__main__":
    if "--print" in sys.argv:
        print(json.dumps({name: said(name) for name in sys.argv[2:]}))
    else:
        names = sorted({*KEPT, *sys.argv[1:]})
        write(FILE, on_every_processor("tests.refkin.test_proofs", *names))
