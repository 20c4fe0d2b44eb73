"""A compensator as a component: the fixed-point C that ``anhyst compile`` writes."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from anhyst.compilation.verb import compile_actuator
from anhyst.exchange.part import WRAPPER, Part, Variable, header, kernel_of
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike

Kind = Literal["full", "simplified"]


def compensator_part(model: Model | PathLike, rate: float, kind: Kind) -> Part:
    """Return a compensator that ticks at its own rate: demand and gap in, current out."""
    with tempfile.TemporaryDirectory(prefix="anhyst-part-") as scratch:
        folder = Path(scratch) / "controller"
        compiled = compile_actuator(model, folder, rate=rate, kind=kind, io="q31")
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        name = manifest["name"]
        own = [path for part in ("include", "src") for path in (folder / part).rglob("*.[ch]")]
        own += [folder / f"{name}_parameters.c", folder / f"{name}_parameters.h"]
        sources = {path.relative_to(folder).as_posix(): path.read_bytes() for path in own}
    sources["compensator.c"] = (WRAPPER / "compensator.c").read_bytes()
    sources["compensator_numbers.h"] = _numbers(manifest).encode()
    text = (
        f"Current of a demanded {manifest['signals']['demand']['quantity']}, hysteresis included: "
        f"compensator {compiled.manifest['kind']} in fixed point"
    )
    return Part(name, text, rate, _variables(manifest), sources)


def _numbers(manifest: Mapping[str, Any]) -> str:
    """Return the header that gives the component the names of this actuator."""
    name, signals = manifest["name"], manifest["signals"]
    gap = signals.get("gap")
    ends = gap or {"low": 0.0, "high": 0.0}
    defined = {
        "COMPENSATOR_KERNEL": kernel_of(f"{name.upper()}_KERNEL", f"{name}_parameters"),
        "COMPENSATOR_WORDS": f"{name.upper()}_PARAMETERS_WORDS",
        "COMPENSATOR_FULL_SCALE_DEMAND": float(signals["demand"]["scale"]),
        "COMPENSATOR_FULL_SCALE_CURRENT": float(signals["current"]["scale"]),
        "COMPENSATOR_HAS_GAP": int(gap is not None),
        "COMPENSATOR_GAP_LOW": float(ends["low"]),
        "COMPENSATOR_GAP_HIGH": float(ends["high"]),
        "compensator_parameters": f"{name}_parameters",
    }
    return header("compensator_numbers", defined, f'#include "{name}_parameters.h"\n\n')


def _variables(manifest: Mapping[str, Any]) -> list[Variable]:
    signals = manifest["signals"]
    demand, current, gap = (signals.get(name) for name in ("demand", "current", "gap"))
    low, high = demand["low"], demand["high"]
    text = f"wanted {demand['quantity']}"
    inputs = [Variable("demand", "input", demand["unit"], text, max(0.0, low), low, high)]
    if gap:
        text = f"{gap['quantity']}; beyond its range the nearer end counts"
        low, high = gap["low"], gap["high"]
        inputs.append(Variable("gap", "input", gap["unit"], text, low, low, high))
    text = f"{current['quantity']} that gives it, from the last tick on"
    low, high = current["low"], current["high"]
    inputs.append(Variable("current", "output", current["unit"], text, 0.0, low, high))
    return inputs
