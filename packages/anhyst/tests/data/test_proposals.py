"""Proposed options lead to a correct reading or to a more precise question."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from anhyst.data.clean import ReadOptions
from anhyst.data.loops import Loops
from anhyst.support.errors import InputError
from tests.refusals import in_commands

PLACEHOLDER = re.compile(r"\w+_PER_\w+")
MAX_QUESTIONS = 5

TIMES = {  # header: value of 1 s
    "t_s": 1.0, "Zeit [s]": 1.0, "Time (ms)": 1e3, "TIME": 1.0, "X": 1.0, "Horizontal (s)": 1.0,
    "Second": 1.0, "tout": 1.0, "Temps (secondes)": 1.0, "Tijd [ms]": 1e3, "Tiempo (us)": 1e6,
    "Tempo (min)": 1.0 / 60.0, "timestamp": 1.0, "Elapsed [Seconds]": 1.0, "x-axis (s)": 1.0,
}  # fmt: skip
CURRENTS = {  # header: value of 1 A
    "I_A": 1.0, "Strom [A]": 1.0, "Courant (mA)": 1e3, "Intensité (A)": 1.0, "Stroom [mA]": 1e3,
    "Corrente (A)": 1.0, "Corriente (Amps)": 1.0, "Coil current [milliamp]": 1e3, "CH1": 1.0,
    "Channel A (V)": 0.1, "Y1": 1.0, "Spulenstrom [A]": 1.0, "Current, coil (A)": 1.0,
    "current probe [mV]": 100.0, "amperage": 1.0, "CurrentMonitor (V)": 0.5, "I=coil [A]": 1.0,
    "drive [furlong]": 7.0, "Strom": 1.0, "yout_1": 1.0, "Courant [kA]": 1e-3, "Current (MA)": 1e-6,
}  # fmt: skip
FORCES = {  # header: value of 1 N
    "F_N": 1.0, "Kraft [N]": 1.0, "Effort (daN)": 0.1, "Kracht [kN]": 1e-3, "Forza (mN)": 1e3,
    "Fuerza (kgf)": 1 / 9.80665, "Force [kg]": 1 / 9.80665, "Load cell (lbf)": 1 / 4.4482216152605,
    "CH2": 1.0, "Channel B (mV)": 20.0, "Y2": 1.0, "Force, z (N)": 1.0, "force z [kilonewton]": 1e-3,
    "pull [ozf]": 1 / 0.27801385095378125, "Load cell (V)": 0.02, "Kraft [g]": 1e3 / 9.80665,
    "Tension [N]": 1.0, "Spannung Kraftaufnehmer [mV]": 3.0, "thing [kp]": 1 / 9.80665,
    "Kraft": 1.0, "yout_2": 1.0, "response [quux]": 4.0, "Force (GN)": 1e-9,
}  # fmt: skip


@dataclass(frozen=True)
class Bench:
    """A record, its headers, and the user's knowledge about the sensors."""

    headers: tuple[str, str, str]  # names of time, current and force
    order: tuple[int, ...]  # units in the file
    values: tuple[np.ndarray, np.ndarray, np.ndarray]  # values in SI units

    def write(self, path: Path) -> Path:
        """Write the record in the units of its headers."""
        sizes = [table[name] for table, name in zip(TABLES, self.headers, strict=True)]
        columns = [values * size for values, size in zip(self.values, sizes, strict=True)]
        names = [f'"{name}"' if "," in name else name for name in self.headers]
        lines = [",".join(names[index] for index in self.order)]
        rows = zip(*(columns[index] for index in self.order), strict=True)
        lines += [",".join(f"{value:.12g}" for value in row) for row in rows]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def complete(self, scales: str) -> str:
        """Replace the placeholders of a message by the values of the data sheets."""
        known = {name: 1.0 / table[name] for table, name in zip(TABLES, self.headers, strict=True)}
        return ",".join(
            PLACEHOLDER.sub(repr(known[pair.rpartition("=")[0].strip('"')]), pair)
            for pair in re.findall(r'(?:"[^"]*"|[^,"])+', scales)
        )


TABLES = (TIMES, CURRENTS, FORCES)


def bench_of(seed: int) -> Bench:
    """Return a bench with random headers and a random order of the columns."""
    draw = np.random.default_rng(seed)
    headers = tuple(str(draw.choice(list(table))) for table in TABLES)
    # Channels without words are in the order input, output.
    order = tuple(draw.permutation(3).tolist()) if draw.random() < 0.3 else (0, 1, 2)
    if order.index(2) < order.index(1):
        order = (0, 1, 2)
    phase = np.linspace(0.0, 4.0 * np.pi, 240)
    current = 1.5 - 1.5 * np.cos(phase) + 0.01 * draw.random()
    force = 8.0 * (current - 0.15 * np.sin(phase) + 0.2) ** 2
    return Bench(headers, order, (0.7 + 1e-3 * np.arange(240), current, force))  # type: ignore[arg-type]


def options_in(text: str) -> dict[str, str]:
    """Return the first value of each option that a message proposes, split as in a shell."""
    found: dict[str, str] = {}
    for match in re.finditer(r"--(columns|scale|flip|drop|loop|schedule) ", text):
        words = shlex.split(text[match.start() :].replace("; ", " "))
        found.setdefault(match[1], words[1])
    return found


def follow(bench: Bench, path: Path) -> Loops | None:
    """Apply proposals until the record is read; ``None`` if a question has no proposal."""
    given: dict[str, str] = {}
    asked: list[str] = []
    for _ in range(MAX_QUESTIONS):
        try:
            return ReadOptions.from_text(**given, clean="none").read([path])
        except InputError as error:
            text = in_commands(error)
        assert text not in asked, f"asked twice: {text}"
        asked.append(text)
        proposed = options_in(text)
        if not proposed:
            return None
        unknown = given | proposed
        if PLACEHOLDER.search(proposed.get("scale", "")):
            with pytest.raises(InputError) as again:  # without a number, it causes another question
                ReadOptions.from_text(**unknown, clean="none").read([path])
            assert again.value.code == "bad-scale", again.value
            proposed["scale"] = bench.complete(proposed["scale"])
        given |= proposed
    raise AssertionError(f"no end of questions: {asked}")


@pytest.mark.parametrize("seed", range(100))
def test_a_proposal_is_right_or_asks_a_question(seed: int, tmp_path: Path) -> None:
    bench = bench_of(seed)
    loops = follow(bench, bench.write(tmp_path / "loops.csv"))
    if loops is None:
        return
    (loop,) = loops.loops
    assert (loops.input.name, loops.output.name) == ("current", "force"), bench.headers
    np.testing.assert_allclose(loop.input, bench.values[1], rtol=1e-9, err_msg=str(bench.headers))
    np.testing.assert_allclose(loop.output, bench.values[2], rtol=1e-9, err_msg=str(bench.headers))
    if loop.time is not None:
        np.testing.assert_allclose(loop.time, bench.values[0], rtol=1e-9)


def test_two_columns_in_the_missing_unit_are_a_choice(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Strom [A],Fx [N],Fz [N]\n" + "0,1,2\n1,2,3\n" * 20)
    with pytest.raises(InputError) as caught:
        ReadOptions().read([path])
    assert '--columns "Fx [N]=F_N" or --columns "Fz [N]=F_N"' in in_commands(caught.value)


def test_two_words_for_a_quantity_are_a_choice(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Strom oben [A],Strom unten [mA],Kraft [N]\n" + "0,1,2\n1,2,3\n" * 20)
    with pytest.raises(InputError) as caught:
        ReadOptions().read([path])
    assert caught.value.code == "column-twice"
    loops = ReadOptions.from_text(columns="Strom unten [mA]=I").read([path])
    assert loops.loops[0].input.max() == pytest.approx(2e-3)


def test_displacement_is_not_output_next_to_force_in_volts(tmp_path: Path) -> None:
    """A displacement is not the output if the file has a force in volts of its sensor."""
    path = tmp_path / "a.csv"
    path.write_text("Strom [A],Kraft [V],Weg [mm]\n" + "0,1,2\n1,2,3\n" * 20)
    with pytest.raises(InputError) as caught:
        ReadOptions().read([path])
    assert 'Kraft [V]=F_N" --scale "Kraft [V]=N_PER_V"' in in_commands(caught.value)


def test_the_provenance_preserves_names_with_commas_quotes_and_equals_signs() -> None:
    columns = {"Current, coil (A)": "I_A", 'F "z", N': "F_N", "a=b": "t_s", '"q"': "", 'x "y"': "x_m"}
    options = ReadOptions(columns=columns, flip=("F, z",), scale={"a, b": "2"})
    texts = {name.removeprefix("read_"): str(v) for name, v in options.as_settings().items()}
    assert ReadOptions.from_text(**texts) == options
