"""What is given away beside the code says what pyproject.toml says."""

import json
import re
import sys
from pathlib import Path

import yaml

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert set(citation["keywords"]) <= set(PROJECT["keywords"])


def test_the_container_takes_and_runs_what_there_is() -> None:
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    copied = [word for line in lines if line.startswith("COPY ") for word in line.split()[1:-1]]
    given = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert sorted(f"!{name}" for name in copied) == [g for g in given if g.startswith("!")]
    assert [name for name in copied if not (ROOT / name).exists()] == []
    # Whatever building the package reads has to be there.
    packages = {PROJECT["readme"], *PROJECT["license-files"], "pyproject.toml", "templates"}
    assert packages <= set(copied)
    (extras,) = re.findall(r"'\.\[(.*)\]'", "\n".join(lines))
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    assert json.loads(lines[-1].removeprefix("CMD "))[0] in PROJECT["scripts"]


def test_extras_name_each_other_rightly() -> None:
    extras = PROJECT["optional-dependencies"]
    named = {
        name
        for needs in extras.values()
        for need in needs
        for names in re.findall(rf"{PROJECT['name']}\[(.*)\]", need)
        for name in names.split(",")
    }
    assert named <= set(extras)
    # In the tests nothing is skipped for want of an extra.
    assert named | {"dev"} == set(extras)
