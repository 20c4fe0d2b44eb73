"""Lay a compiled folder out as a package for CMSIS-Pack, Zephyr, PlatformIO, Arduino or Cargo.

A package contains the files of the folder at other paths. It also contains files made from
templates: a manifest, an example that runs the golden vectors, and a README. Each entry of PACKAGES
describes the layout for one build system.
"""

from __future__ import annotations

import csv
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from io import BytesIO, StringIO
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from anhyst.compilation.source import render
from anhyst.compilation.vectors import COLUMNS, LEVITATION_COLUMNS
from anhyst.support.errors import InputError

Files = dict[str, str | bytes]
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Ecosystem:
    """Layout of a package that one build system expects."""

    title: str  # headline of the README
    # folder in the package for each part of the compiled folder: core headers, core sources, port,
    # headers and sources of the actuator, documents; a part without an entry is left out
    folders: Mapping[str, str]
    # template of each further file; {name} in a path becomes the name of the actuator
    templates: Mapping[str, str]
    print_function: str = "printf"  # function by which the example prints
    # function that changes the text of a C file, given its path and its text
    edit_source: Callable[[str, str, Values], str] | None = None
    # function that makes further files from all files, such as an archive
    make_archive: Callable[[Files, Values], Files] | None = None


FP_CONTRACT_OFF = """\
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif
"""
"""Pragma that prevents fused products and sums, for packages that cannot pass -ffp-contract=off."""


def _forbid_fused_products(path: str, text: str, values: Values) -> str:
    """Add the pragma against fused products to a C source in single precision."""
    return FP_CONTRACT_OFF + text if values["real"] and path.endswith(".c") else text


def _prefix_symbols(path: str, text: str, values: Values) -> str:
    """Put the name of the actuator in front of every name of the core, except names of headers.

    Each crate contains a copy of the core. Two crates in one program must not share its symbols,
    because their cores may differ in version or in size.
    """
    return re.sub(r'(?<!")\banhyst_(?=\w)', f"{values['name']}_anhyst_", text)


def _make_archive(files: Files, values: Values) -> Files:
    """Return the pack: all files in one archive.

    The archive is not compressed, because its bytes would depend on the version of the compressor.
    """
    archive_bytes = BytesIO()
    with zipfile.ZipFile(archive_bytes, "w") as archive:
        for name, content in sorted(files.items()):
            entry = zipfile.ZipInfo(name)
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, content)
    return {f"anhyst.{values['name']}.{values['semver']}.pack": archive_bytes.getvalue()}


MODULE_FOLDERS = {
    "include": "include", "src": "src", "port": "port", "headers": "actuator",
    "sources": "actuator", "docs": "docs", "example": "docs",
}  # fmt: skip
"""Folders of a package whose build lists its files. The core and the actuator are in different
folders."""

VECTORS_TEMPLATE = "golden_vectors.h.j2"
MAIN_TEMPLATE = "golden_main.c.j2"

PACKAGES: Mapping[str, Ecosystem] = {
    "cmsis-pack": Ecosystem(
        "CMSIS-Pack",
        folders=MODULE_FOLDERS,
        templates={
            "anhyst.{name}.pdsc": "cmsis/pack.pdsc.j2",
            "README.md": "cmsis/README.md.j2",
            "examples/golden_vectors/main.c": "cmsis/main.c.j2",
            "examples/golden_vectors/golden_vectors.h": VECTORS_TEMPLATE,
            "examples/golden_vectors/golden_vectors.csolution.yml": "cmsis/csolution.yml.j2",
            "examples/golden_vectors/golden_vectors.cproject.yml": "cmsis/cproject.yml.j2",
        },
        make_archive=_make_archive,
    ),
    "zephyr": Ecosystem(
        "Zephyr module",
        folders=MODULE_FOLDERS,
        templates={
            "zephyr/module.yml": "zephyr/module.yml.j2",
            "zephyr/CMakeLists.txt": "zephyr/CMakeLists.txt.j2",
            "zephyr/Kconfig": "zephyr/Kconfig.j2",
            "README.md": "zephyr/README.md.j2",
            "samples/golden_vectors/CMakeLists.txt": "zephyr/sample.cmake.j2",
            "samples/golden_vectors/prj.conf": "zephyr/prj.conf.j2",
            "samples/golden_vectors/sample.yaml": "zephyr/sample.yaml.j2",
            "samples/golden_vectors/src/main.c": MAIN_TEMPLATE,
            "samples/golden_vectors/src/golden_vectors.h": VECTORS_TEMPLATE,
        },
        print_function="printk",
    ),
    "platformio": Ecosystem(
        "PlatformIO library",
        folders={
            "include": "include", "src": "src", "port": "include", "headers": "include",
            "sources": "src", "docs": "docs", "example": "docs",
        },
        templates={
            "library.json": "platformio/library.json.j2",
            "README.md": "platformio/README.md.j2",
            "examples/golden_vectors/platformio.ini": "platformio/platformio.ini.j2",
            "examples/golden_vectors/src/main.c": MAIN_TEMPLATE,
            "examples/golden_vectors/src/golden_vectors.h": VECTORS_TEMPLATE,
        },
    ),
    "arduino": Ecosystem(
        "Arduino library",
        folders={
            "include": "src", "src": "src", "headers": "src", "sources": "src", "docs": "extras", "example": "extras",
        },
        templates={
            "library.properties": "arduino/library.properties.j2",
            "keywords.txt": "arduino/keywords.txt.j2",
            "README.md": "arduino/README.md.j2",
            "examples/golden_vectors/golden_vectors.ino": "arduino/golden_vectors.ino.j2",
            "examples/golden_vectors/golden_vectors.h": VECTORS_TEMPLATE,
        },
        edit_source=_forbid_fused_products,
    ),
    "cargo": Ecosystem(
        "Rust crate",
        folders={
            "include": "c/include", "src": "c/src", "port": "c/port", "headers": "c/actuator",
            "sources": "c/actuator", "docs": "docs", "example": "docs",
        },
        templates={
            "Cargo.toml": "cargo/Cargo.toml.j2",
            "build.rs": "cargo/build.rs.j2",
            "README.md": "cargo/README.md.j2",
            "src/lib.rs": "cargo/lib.rs.j2",
            "src/ffi.rs": "cargo/ffi.rs.j2",
            "c/actuator/{name}_binding.c": "cargo/binding.c.j2",
            "tests/golden_vectors.rs": "cargo/golden_vectors.rs.j2",
        },
        edit_source=_prefix_symbols,
    ),
}  # fmt: skip
"""Package layouts by the name that --package accepts."""


def check_package(package: str | None) -> None:
    """Raise an error if a package is unknown."""
    if package is not None and package not in PACKAGES:
        text = f"--package: unknown package '{package}'; give {', '.join(PACKAGES)}"
        raise InputError(text, code="unknown-package", key="--package")


def make_package_files(
    package: str | None, files: Mapping[str, str], manifest: Mapping[str, Any], values: Values
) -> Mapping[str, str | bytes]:
    """Return the content of each file of a package by its path.

    If no package is requested, the result is the files of the compiled folder. ``files`` and
    ``manifest`` describe the compiled folder; ``values`` are the template values of its example.
    """
    if package is None:
        return files
    ecosystem = PACKAGES[package]
    package_paths = {name: _package_path(name, ecosystem, values["name"]) for name in files}
    contents: Files = {
        package_path: _edit_file(ecosystem, package_path, files[name], values)
        for name, package_path in package_paths.items()
        if package_path is not None
    }
    template_values = _template_values(files, manifest, values)
    template_values |= {"title": ecosystem.title, "print": ecosystem.print_function}
    for pattern, template in ecosystem.templates.items():
        path = pattern.format(name=values["name"])
        contents[path] = _edit_file(ecosystem, path, render(f"packages/{template}", template_values), values)
    contents["LICENSE"] = license_text()
    if ecosystem.make_archive is None:
        return contents
    return contents | ecosystem.make_archive(contents, template_values)


def _edit_file(ecosystem: Ecosystem, path: str, text: str, values: Values) -> str:
    """Return the text of a file of the package. Only C files and the guide can be changed."""
    if path.endswith("/DROP_IN.md"):
        return _edit_guide(text)
    if ecosystem.edit_source is None or not path.endswith((".c", ".h")):
        return text
    return ecosystem.edit_source(path, text, values)


def _edit_guide(text: str) -> str:
    """Return the drop-in guide without the files that a package does not need."""
    text = re.sub(r"`anhyst.mk` and `anhyst.cmake` do both\.", "The package does both.", text)
    text = re.sub(
        r"`anhyst.mk` and `anhyst.cmake`( of both\s+folders)?", "the manifests of the packages", text
    )
    text = re.sub(r"(?m)^\| `main.c` \|.*\n", "", text)
    text = text.replace("`main.c` contains this, ready to run. On a PC it plays", "The example plays")
    return text.replace("`example/interrupt.c`", "`interrupt.c`")


def _package_path(path: str, ecosystem: Ecosystem, name: str) -> str | None:
    """Return the path of a compiled file in the package, or None if the package omits it."""
    part, _, inner_path = path.partition("/")
    if not inner_path:
        part, inner_path = _folder_part(path, name), path
    target_folder = ecosystem.folders.get(part)
    return None if target_folder is None else f"{target_folder}/{inner_path}"


def _folder_part(file: str, name: str) -> str:
    """Return the part of the compiled folder to which a file without a folder belongs."""
    suffix = PurePosixPath(file).suffix
    if file.startswith(f"{name}_") and suffix in {".c", ".h"}:
        return "headers" if suffix == ".h" else "sources"
    return "replaced" if file in {"main.c", "anhyst.mk", "anhyst.cmake"} else "docs"


def _template_values(files: Mapping[str, str], manifest: Mapping[str, Any], values: Values) -> dict[str, Any]:
    """Return the values for the templates."""
    version = re.match(r"\d+\.\d+\.\d+", values["version"])
    table = files["controller.csv" if values["control"] else "vectors.csv"]
    own_files = [name for name in files if name.startswith(f"{values['name']}_")]
    core_sources = sorted(name for name in files if name.startswith("src/") and name.endswith(".c"))
    return {
        **values,
        "semver": version[0] if version else "0.0.0",
        "core": {name: PurePosixPath(name).stem for name in core_sources},
        # names of components have at least two characters
        "component": values["name"] if len(values["name"]) > 1 else f"actuator_{values['name']}",
        "core_files": sorted(name for name in files if name.startswith(("include/", "src/"))),
        "own_sources": sorted(name for name in own_files if name.endswith(".c")),
        "own_headers": sorted(name for name in own_files if name.endswith(".h")),
        "header": f"{values['name']}_{'controller' if values['control'] else 'parameters'}.h",
        "signals": manifest["signals"],
        "memory": manifest["memory"],
        "controller": manifest["controller"],
        **_rust_values(manifest),
        "rate": f"{manifest['rate_Hz']:g}",
        "statuses": _statuses(files),
        "flags": _flags(files),
        "rows": _vector_rows(table, values),
        "fp_contract_off": FP_CONTRACT_OFF,
    }


RUST_TYPES = {"q15": "i16", "q31": "i32", "f32": "f32"}
RUST_REALS = {"q15": "f32", "q31": "f64", "f32": "f32"}
"""Rust type of a value in SI units, for each signal format."""


def _rust_values(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that only the templates of a Rust crate need."""
    io, controller = manifest["io"], manifest["controller"]
    signals = {name: signal for name, signal in manifest["signals"].items() if signal is not None}
    number = float if io == "q31" else np.float32
    return {
        "rust": RUST_TYPES[io],
        "rust_si": RUST_REALS[io],
        "literals": {
            name: {key: str(number(signal[key])) for key in ("low", "high", "scale")}
            for name, signal in signals.items()
        },
        "middle": {
            name: str(float(f"{0.5 * (signal['low'] + signal['high']):.4g}"))
            for name, signal in signals.items()
        },
        "state_bytes": _bytes_by_pointer_size(manifest["memory"]["state_bytes"]),
        "controller_bytes": _bytes_by_pointer_size(controller["state_bytes"]) if controller else {},
    }


def _bytes_by_pointer_size(size: int) -> dict[int, int]:
    """Return memory for a structure whose size is known for pointers of 32 bits.

    With pointers of 64 bits, a structure is at most twice as large.
    """
    return {32: -(-size // 8) * 8, 64: -(-2 * size // 8) * 8}


def _statuses(files: Mapping[str, str]) -> list[tuple[str, int, str]]:
    """Return name, number and meaning of every status that is an error."""
    text = files["include/anhyst/numeric/status.h"]
    matches = re.findall(r"/\* ([^*]+) \*/\s*ANHYST_(\w+) = (-\d+)", text)
    return [(_camel_case(name), int(number), " ".join(meaning.split())) for meaning, name, number in matches]


def _flags(files: Mapping[str, str]) -> list[tuple[str, int]]:
    """Return name and value of every flag."""
    text = files["include/anhyst/compensator/flags.h"]
    return [(name, int(value)) for name, value in re.findall(r"#define ANHYST_(\w+) (\d+)U", text)]


def _camel_case(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def _vector_rows(table: str, values: Values) -> list[str]:
    """Return the golden vectors as rows of constants in C."""
    columns = LEVITATION_COLUMNS if values["control"] else COLUMNS
    text = _float_bits if values["real"] else _int_constant
    rows = csv.DictReader(StringIO(table))
    return [", ".join(text(row[name]) for name in columns) for row in rows]


def _int_constant(cell: str) -> str:
    """Return a code in C, where -2147483648 is not a constant of 32 bits."""
    return f"({int(cell) + 1} - 1)" if int(cell) == -(2**31) else cell


def _float_bits(cell: str) -> str:
    """Return the bits of a number in single precision."""
    return f"0x{int(np.float32(cell).view(np.uint32)):08X}"


def license_text() -> str:
    """Return the licence of anhyst, from the installed package."""
    try:
        text = distribution("anhyst").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        text = None
    if text is None:
        file = Path(__file__).resolve().parents[3] / "LICENSE"
        if not file.is_file():
            raise InputError(
                "the licence of anhyst is missing; install anhyst again", code="installation-incomplete"
            )
        text = file.read_text(encoding="utf-8")
    return text
