"""Reading a rig file of any kind, and saying where in it something is wrong."""

from __future__ import annotations

from collections.abc import Collection

from anhyst.rig.file import RigFile
from anhyst.rig.kind_rules import rule_faults
from anhyst.rig.loop_files import identify_faults
from anhyst.rig.old_files import modernise, rig_error
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import FileKind
from anhyst.support.toml_file import read_toml


def read_rig_file(path: PathLike, kinds: Collection[FileKind]) -> RigFile:
    """Read the rig file of one of some kinds; files of older formats are read with a warning."""
    file = read_toml(path, RigFile, kinds=kinds, prepare=modernise)
    faults = rule_faults(file)
    if file.given_loops is not None:
        faults += identify_faults(file.loops)
    if faults:
        raise rig_error(path, faults)
    return file
