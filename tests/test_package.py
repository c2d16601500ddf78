"""What is installed: one version everywhere, types, and every file that is read beside the modules."""

from __future__ import annotations

import subprocess
import sys
import zipfile

import pytest

import refkin
from tests.houseplan import ROOT

READ_BESIDE_MODULES = (".toml", ".j2", ".css", ".js", ".c", ".h", "py.typed")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    (file,) = folder.glob("*.whl")
    with zipfile.ZipFile(file) as packed:
        yield file.name, set(packed.namelist())


def test_a_wheel_holds_every_file_that_is_read(wheel):
    read = [p for folder in ("refkin", "crosscheck") for p in (ROOT / folder).rglob("*")]
    expected = {str(p.relative_to(ROOT)) for p in read if p.name.endswith((".py", *READ_BESIDE_MODULES))}

    assert expected - wheel[1] == set()
    assert "crosscheck/night/baseline.json" in wheel[1]


def test_a_wheel_bears_the_version_of_the_module(wheel):
    cited = [line for line in (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines() if "version: 0" in line]

    assert wheel[0].startswith(f"refkin-{refkin.__version__}-")
    assert cited == [f"version: {refkin.__version__}"]
