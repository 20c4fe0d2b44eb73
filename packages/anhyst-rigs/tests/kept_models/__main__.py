"""Identify the kept models again, all of them or those that are named."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from anhyst.model.writer import write_model
from tests.kept_models.making import MODEL_RECIPES
from tests.repository import ROOT
from tests.truths import path_of

for name in sys.argv[1:] or MODEL_RECIPES:
    print(f"truths: {name}", flush=True)
    model = MODEL_RECIPES[name].identify()
    origin = model.provenance
    # The same file wherever the project lies.
    sources = tuple(replace(one, path=str(Path(one.path).relative_to(ROOT))) for one in origin.sources)
    write_model(replace(model, provenance=replace(origin, sources=sources)), path_of(name))
