"""Identify the kept models again, all of them or those that are named."""

from __future__ import annotations

import sys

from anhyst.model.writer import write_model
from tests.truths import TRUTHS, path_of

for name in sys.argv[1:] or TRUTHS:
    print(f"truths: {name}", flush=True)
    write_model(TRUTHS[name].identify(), path_of(name))
