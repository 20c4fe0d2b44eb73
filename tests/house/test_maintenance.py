"""Test the files of maintainers: workflows, forms, licences, citation records, paper and recipe.

The workflows cannot run here. The tests check them with linters that work without a network.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import rattler_build
import yaml

from tests.repository import ROOT

BIN = Path(sys.executable).parent
GITHUB = ROOT / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.yml"))
PARTS = ("anhyst", "anhyst-rigs", "anhyst-exchange")

SCHEMAS = {
    "github-workflows": WORKFLOWS,
    "github-issue-forms": sorted((GITHUB / "ISSUE_TEMPLATE").glob("[!c]*.yml")),
    "github-issue-config": [GITHUB / "ISSUE_TEMPLATE" / "config.yml"],
    "dependabot": [GITHUB / "dependabot.yml"],
    "citation-file-format": [ROOT / "CITATION.cff"],
}
"""Files that check-jsonschema compares with a schema that it contains."""

CONDA_NAMES = {"matplotlib": "matplotlib-base"}
"""Packages whose name differs between PyPI and conda."""


def run_linter(name: str, *arguments: str | Path) -> None:
    """Run an installed linter in the repository; fail with its output if it finds a fault."""
    command = [str(BIN / name), *map(str, arguments)]
    completed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr


def read_yaml(path: Path) -> Any:
    """Return the contents of a YAML file."""
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def read_project(part: str) -> dict[str, Any]:
    """Return the metadata of a part of the project."""
    text = (ROOT / "packages" / part / "pyproject.toml").read_text(encoding="utf-8")
    project: dict[str, Any] = tomllib.loads(text)["project"]
    return project


def collect_commands(workflow: dict[str, Any]) -> list[str]:
    """Return the shell commands in the steps of a workflow."""
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    return [step["run"] for step in steps if "run" in step]


@pytest.mark.parametrize("schema", SCHEMAS)
def test_file_agrees_with_schema(schema: str) -> None:
    assert SCHEMAS[schema]
    run_linter("check-jsonschema", "--builtin-schema", f"vendor.{schema}", *SCHEMAS[schema])


def test_workflows_are_secure() -> None:
    """Actions are pinned by commit, permissions are minimal, and no step executes text from outside."""
    run_linter("zizmor", "--offline", "--no-progress", "--quiet", GITHUB)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflow_uses_existing_targets_and_scripts(path: Path) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):(?!=)", makefile, re.MULTILINE))
    commands = "\n".join(collect_commands(read_yaml(path)))
    for target in re.findall(r"^make ([a-z-]+)", commands, re.MULTILINE):
        assert target in targets
    for script in re.findall(r"\bbash (\S+)", commands):
        assert (ROOT / script).is_file()
    for folder in re.findall(r"(packages/[a-z-]+)", commands):
        assert (ROOT / folder / "pyproject.toml").is_file()


def test_every_file_has_licence_information() -> None:
    run_linter("reuse", "lint", "--quiet")


def test_data_of_others_keep_their_licence() -> None:
    """A task of the benchmark with a licence text of its own has an entry, not the general licence."""
    annotations = tomllib.loads((ROOT / "REUSE.toml").read_text(encoding="utf-8"))["annotations"]
    paths = [entry["path"] for entry in annotations]
    listed = {path for group in paths for path in ([group] if isinstance(group, str) else group)}
    for licence in (ROOT / "benchmarks" / "zoo" / "tasks").glob("*/LICENSE"):
        assert (licence.parent / "records.csv").relative_to(ROOT).as_posix() in listed


def test_licence_texts_agree() -> None:
    assert (ROOT / "LICENSES" / "Apache-2.0.txt").read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_citation_records_agree() -> None:
    citation = read_yaml(ROOT / "CITATION.cff")
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    codemeta = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
    paper = read_paper_header()
    authors = [author["name"] for author in citation["authors"]]
    for record in (zenodo["creators"], codemeta["author"], paper["authors"]):
        assert [author["name"] for author in record] == authors
    assert zenodo["title"] == paper["title"] == citation["title"]
    assert codemeta["license"].endswith(f"/{citation['license']}")
    assert zenodo["license"] == citation["license"]
    versions = {str(record["version"]) for record in (citation, zenodo, codemeta)}
    assert versions == {read_project(part)["version"] for part in PARTS}
    assert zenodo["keywords"] == codemeta["keywords"] == read_project("anhyst")["keywords"]


def read_paper_header() -> dict[str, Any]:
    """Return the metadata at the top of the paper."""
    text = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    header: dict[str, Any] = yaml.safe_load(text.split("---\n")[1])
    return header


def test_paper_has_the_required_form() -> None:
    body = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8").split("---\n", 2)[2]
    assert re.findall(r"^# (.*)$", body, re.MULTILINE) == [
        "Summary",
        "Statement of need",
        "State of the field",
        "Software design",
        "Research impact statement",
        "AI usage disclosure",
        "Acknowledgements",
        "References",
    ]
    assert 750 <= len(body.split()) <= 1750
    references = (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8")
    assert set(re.findall(r"@(\w+\d{4}|jamodel)\b", body)) == set(
        re.findall(r"^@\w+\{(\w+),", references, re.M)
    )


def test_conda_recipe_renders_and_agrees_with_the_parts() -> None:
    folder = ROOT / "recipe"
    recipe = rattler_build.Stage0Recipe.from_file(folder / "recipe.yaml")
    variants = rattler_build.VariantConfig.from_file(folder / "variants.yaml")
    rendered = {variant.recipe.package.name: variant.recipe.to_dict() for variant in recipe.render(variants)}
    assert sorted(rendered) == sorted(PARTS)
    for part, package in rendered.items():
        project = read_project(part)
        assert package["package"]["version"] == project["version"]
        assert package["about"]["license"] == project["license"]
        names = [re.split(r"(?=[=<>])", requirement, maxsplit=1) for requirement in project["dependencies"]]
        required = {f"{CONDA_NAMES.get(name, name)} {bound}" for name, bound in names}
        required.add(f"python {project['requires-python']}")
        assert set(package["requirements"]["run"]) == required
        for licence in package["about"]["license_file"]:
            assert (ROOT / licence).is_file()
