"""Hash everything that a proof and its control depend on."""

from __future__ import annotations

import hashlib
import json
import subprocess
import tempfile
from pathlib import Path

from tools.prove import verdict
from tools.prove.copies import copy_core
from tools.prove.listing import ROOT, Proof
from tools.prove.provers import command, include_arguments, sources


def files_read(proof: Proof, core: Path) -> list[Path]:
    """Return the sources and headers that a proof reads in a copy of core/.

    A file counts as a whole, even if a tool's preprocessor removes parts of it.
    """
    listing = ["cc", "-std=c99", "-MM", *include_arguments(proof, core), *map(str, sources(proof, core))]
    rules = subprocess.run(listing, capture_output=True, text=True, check=True).stdout
    return sorted({Path(word) for word in rules.split() if word[-1] not in ":\\"})


def content_hash(proof: Proof, version: str, core: Path = ROOT / "core") -> str:
    """Return a hash over the contents that a proof depends on.

    Parameters
    ----------
    proof : Proof
        The proof. Its annotations, contracts and seeded fault are part of the contents.
    version : str
        Version text of its tool.
    core : Path
        The folder core/.

    Returns
    -------
    str
        SHA-256 over every file that the proof reads (with and without the fault), the arguments and
        the version of the tool, and the code that reads the tool's verdict. The paths of the folders
        do not count.
    """
    with tempfile.TemporaryDirectory() as folder:
        parts: list[object] = [proof.name, version]
        parts.append(Path(verdict.__file__).read_text(encoding="utf-8"))
        for is_broken in (False, True):
            copy = Path(folder) / ("broken" if is_broken else "right") / "core"
            copy_core(core, proof, copy, broken=is_broken)
            folders = {f"{copy.parent}/": "", f"{ROOT}/": ""}
            program, *arguments = command(proof, copy)
            texts = {str(f): f.read_text(encoding="utf-8") for f in files_read(proof, copy)}
            parts += [Path(program).name, [remove_folder_paths(folders, word) for word in arguments]]
            parts.append({remove_folder_paths(folders, name): text for name, text in texts.items()})
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def remove_folder_paths(folders: dict[str, str], text: str) -> str:
    """Return a text without the paths of folders."""
    for folder, replacement in folders.items():
        text = text.replace(folder, replacement)
    return text
