"""Copy core/ for a proof, or for its control, which contains a seeded fault."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from tools.prove.listing import Proof


def replace_once(file: Path, old_text: str, new_text: str) -> None:
    """Replace a text in a copy. The text must occur exactly once."""
    text = file.read_text(encoding="utf-8")
    if text.count(old_text) != 1:
        raise ValueError(f"{file.name}: {old_text!r} does not occur exactly once; adapt proofs.toml")
    file.write_text(text.replace(old_text, new_text), encoding="utf-8")


def replace_by_contract(file: Path, function: str) -> None:
    """Turn a static function into a declaration, so that the harness can define it."""
    text = file.read_text(encoding="utf-8")
    head = re.compile(rf"^(static [^;{{}}()]*\b){function}(\([^;{{}}]*\))\s\{{", re.MULTILINE)
    if len(head.findall(text)) != 1:
        raise ValueError(f"{file.name}: no static function {function}; adapt proofs.toml")
    declared = rf"\1{function}\2;\n\1{function}_body\2\n{{"
    file.write_text(head.sub(declared, text), encoding="utf-8")


def copy_core(core: Path, proof: Proof, target: Path, *, broken: bool) -> None:
    """Copy core/ with the annotations of a proof; if broken, also with the fault of its control."""
    shutil.copytree(core, target)
    if broken:
        control = proof.control
        replace_once(target / control["file"], control["right"], control["wrong"])
    for file, text, facts in proof.facts:
        replace_once(target / file, text, facts + text)
    for item in proof.contracts:
        file, function = item.split(":")
        replace_by_contract(target / file, function)
