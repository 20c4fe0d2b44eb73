"""Test the size metrics: they may only fall, and ARCHITECTURE.md prints the counted values."""

from __future__ import annotations

import ast
import json
import tomllib
from functools import cache

from anhyst import __version__
from tools import house

numbers = cache(house.count_metrics)


def test_no_number_of_the_house_has_risen() -> None:
    limits = json.loads(house.RECORD.read_text(encoding="utf-8"))
    current_metrics = house.round_up(numbers())
    assert current_metrics.keys() == limits.keys()
    assert {name: value for name, value in current_metrics.items() if value > limits[name]} == {}


def test_the_architecture_page_agrees_with_the_command() -> None:
    page = house.PAGE.read_text(encoding="utf-8")
    assert house.format_table(numbers()) in page, "run make house"


def test_the_architecture_prints_the_layers_that_are_enforced() -> None:
    project = tomllib.loads((house.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    page = house.PAGE.read_text(encoding="utf-8")
    for layers in (contract["layers"] for contract in contracts if "containers" in contract):
        assert f"\n    {', '.join(layers)}\n" in page


def test_imports_inside_functions_are_counted() -> None:
    sources = {
        "anhyst": "",
        "anhyst.a": "from anhyst import b",
        "anhyst.b": "from anhyst.b import inner",
        "anhyst.b.inner": "def late():\n    import anhyst.c\n",
        "anhyst.c": "if TYPE_CHECKING:\n    from anhyst.b import Name\n",
    }
    graph = house.find_imports({name: ast.parse(text) for name, text in sources.items()})
    assert graph["anhyst.a"] == {"anhyst.b"}
    assert house.find_cycles(graph) == [{"anhyst.b", "anhyst.b.inner", "anhyst.c"}]


def test_names_of_number_formats_are_in_one_list() -> None:
    """This way, a debugger, a text search and an index of names find the functions of the core."""
    files = [path for path in (house.ROOT / "core").rglob("*.[ch]") if path.parent.name != "numeric"]
    assert len(files) > 100
    assert [path.name for path in files if "ANHYST_NAME" in path.read_text("utf-8")] == []


def test_an_upward_import_is_counted_anywhere_in_a_file() -> None:
    sources = {
        "anhyst": "def late():\n    import anhyst_rigs.rig\n",
        "anhyst.data": "",
        "anhyst_rigs.rig": "from anhyst import data",
        "anhyst_rigs.kinds": "if TYPE_CHECKING:\n    from anhyst_exchange.part import Part\n",
        "anhyst_exchange.part": "from anhyst_rigs import rig",
    }
    trees = {name: ast.parse(text) for name, text in sources.items()}
    assert house.count_upward_imports(house.find_imports(trees, include_top_packages=True)) == 2


def test_all_parts_have_one_version_and_one_licence() -> None:
    for part in house.PARTS:
        folder = house.PACKAGES / part
        project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        assert project["version"] == __version__
        required_parts = [
            dependency for dependency in project["dependencies"] if dependency.startswith("anhyst")
        ]
        assert all(one.endswith(f"=={__version__}") for one in required_parts)
        assert list(folder.glob("src/*/py.typed"))
        assert (folder / "LICENSE").read_bytes() == (house.ROOT / "LICENSE").read_bytes()
    steels = house.ROOT / "examples" / "steels" / "LICENSE"
    assert (house.PACKAGES / "anhyst" / "LICENSE.steels").read_bytes() == steels.read_bytes()
