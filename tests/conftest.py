"""What tests share: the command line in this process, and what it said; no drawn case has a deadline."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from hypothesis import settings

from crosscheck.cli import main
from refkin.model import Scene
from refkin.scenes.files import to_toml

settings.register_profile("no speed", deadline=None)  # a busy machine takes as long as it takes
settings.load_profile("no speed")


class Told(NamedTuple):
    """How a command ended, and what it said."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def command(capsys, tmp_path) -> Callable[..., Told]:
    """Return the command line in this process: quicker than one of its own. A scene among the words is a file of it."""

    def word(item: Any) -> str:
        if not isinstance(item, Scene):
            return str(item)
        path = tmp_path / "scene.toml"
        path.write_text(to_toml(item), encoding="utf-8")
        return str(path)

    def run(*words: Any) -> Told:
        with pytest.raises(SystemExit) as ended:
            main([word(item) for item in words])
        return Told(ended.value.code or 0, *capsys.readouterr())

    return run
