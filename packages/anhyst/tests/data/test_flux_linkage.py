"""Records of current and voltage become loops of flux linkage, or are refused with the remedy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from anhyst import read_loops
from anhyst.data import Loop, Loops
from anhyst.data.clean import clean
from anhyst.data.recurrence import estimate_drift, find_curves
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.data.voltage_records import VoltageRecord, draw_record, drive_through, make_record
from tests.refusals import in_commands, refused

RATE = 1000.0
CYCLE = 1000
NESTED = (0.0, 1.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.6, 0.0, 1.0, 0.0)
BOTH_SIGNS = (0.0, 1.0, -1.0, 1.0, -1.0, 0.6, -0.6, 0.6, -0.6, 1.0, -1.0, 0.0)
DEMAGNETISING = tuple(np.resize((1.0, -1.0), 16) * 0.8 ** np.arange(16))


def record(
    points: Sequence[float] = NESTED, seed: int = 1, rest: float = 0.5, **settings: float
) -> VoltageRecord:
    drive = drive_through(points, rest, CYCLE, is_sine=False)
    return make_record(drive, np.random.default_rng(seed), rate=RATE, **settings)  # type: ignore[arg-type]


def columns(made: VoltageRecord, voltage: str = "u_V") -> dict[str, FloatArray]:
    return {"t_s": made.time, "I_A": made.current, voltage: made.voltage}


def write(path: Path, header: str, *values: FloatArray) -> Path:
    lines = [",".join(f"{value:.9g}" for value in row) for row in zip(*values, strict=True)]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def estimates(notes: Sequence[str]) -> tuple[float, float, float]:
    """Return resistance, Ohm, its stated uncertainty, and the uncertainty of the flux, %."""
    text = next(note for note in notes if "integrated from the voltage" in note)
    match = re.search(r"resistance (\S+) ± (\S+) Ohm", text)
    uncertainty = re.search(r"uncertainty (\S+)%", text)
    assert uncertainty is not None
    resistance, sigma = (float(match[1]), float(match[2])) if match else (0.0, 0.0)
    return resistance, sigma, float(uncertainty[1])


def read_drawn(seeds: range) -> tuple[list[float], list[float], list[float]]:
    """Return the errors of drawn records that are accepted, their stated uncertainties, and the number refused."""
    errors, uncertainties, refusals = [], [], []
    for seed in seeds:
        made = draw_record(seed)
        voltage = "u_V" if made.resistance else "u_sense_V"
        turns = {} if made.resistance else {"turns": 20, "sense_turns": 20}
        try:
            loops = read_loops(columns(made, voltage), constants=turns, schedule="none")
        except InputError as error:
            refusals.append(float(re.findall(r"uncertain by (\S+) %", str(error))[0]))
            continue
        errors.append(made.error(loops.loops[0].output))
        uncertainties.append(estimates(loops.notes)[2])
    return errors, uncertainties, refusals


def test_flux_of_drawn_records_is_accurate() -> None:
    """The flux of twelve drawn records has a median error below 0.1 % and none above 0.5 %."""
    errors, uncertainties, refusals = read_drawn(range(12))
    assert len(errors) >= 7
    assert np.median(errors) < 0.1
    assert max(errors) < 0.5
    assert all(value >= 0.2 for value in refusals)
    assert np.sqrt(np.mean((np.array(errors) / np.array(uncertainties)) ** 2)) < 1.5


@pytest.mark.slow
def test_flux_of_many_drawn_records_is_accurate() -> None:
    """The flux of 120 drawn records has a median error below 0.05 % and none above 0.6 %."""
    errors, uncertainties, _ = read_drawn(range(120))
    assert len(errors) >= 80
    assert np.median(errors) < 0.05
    assert max(errors) < 0.6
    assert np.sqrt(np.mean((np.array(errors) / np.array(uncertainties)) ** 2)) < 1.5


@pytest.mark.parametrize("seed", range(4))
def test_resistance_warming_and_offset_are_estimated(seed: int) -> None:
    """The resistance is within 0.3 %, or 4 stated standard deviations, and the warming within 1 %."""
    made = record(seed=seed, ratio=8.0, warming=0.03, offset=6e-3)
    note = next(note for note in read_loops(columns(made)).notes if "Ohm" in note)
    resistance, sigma, _ = estimates([note])
    cold = made.resistance / 1.0175  # the mean over the heat of a warming by 3 %
    assert resistance == pytest.approx(cold, abs=max(4.0 * sigma, 0.003 * cold))
    warming = re.search(r"warming (\S+) %", note)
    offset = re.search(r"offset (\S+) mV", note)
    assert warming is not None
    assert offset is not None
    assert float(warming[1]) == pytest.approx(3.0, abs=1.0)


@pytest.mark.parametrize(
    ("points", "rest", "settings", "remedy"),
    [
        ((0.0, 1.0, 0.0), 0.0, {}, "at least three faster cycles"),
        (BOTH_SIGNS, 0.5, {}, "hold the largest current"),
        ((0.0, *(1.0, 0.0) * 2), 0.0, {"ratio": 0.3, "offset": 0.0}, "rest at zero current"),
        (NESTED, 0.5, {"ratio": 2000.0, "bits": 12}, "sample faster"),
        (NESTED, 0.5, {"ratio": 300.0, "bits": 16, "noise": 0.0, "cooling": 9.0}, "three faster cycles"),
    ],
)
def test_inseparable_records_are_refused_with_the_remedy(
    points: Sequence[float], rest: float, settings: dict[str, float], remedy: str
) -> None:
    """One cycle, cycles about zero, no rest, and slow cycles are refused with the remedy."""
    with refused("voltage-inaccurate") as caught:
        read_loops(columns(record(points, seed=3, rest=rest, **settings)))
    assert remedy in in_commands(caught.value)


@pytest.mark.parametrize("remedy", [(1.0, 1.0, 0.0), (1.0, 0.0, 1.0, 0.0)])
def test_remedies_of_a_refusal_help(remedy: Sequence[float]) -> None:
    """Cycles about zero are accepted with a hold of the largest current or cycles on one side."""
    made = record((*BOTH_SIGNS, *remedy))
    assert made.error(read_loops(columns(made), schedule="none").loops[0].output) < 0.3


def test_reversed_voltage_is_refused_with_the_option() -> None:
    """A negative resistance is refused, and the proposed option reads the record."""
    made = record()
    table = columns(made) | {"u_V": -made.voltage}
    with refused("voltage-sign u_V"):
        read_loops(table)
    assert made.error(read_loops(table, flip=["u_V"]).loops[0].output) < 0.2


def test_missing_samples_are_refused() -> None:
    """A pause of the recorder is refused, because its voltage is not in the integral."""
    made = record()
    kept = np.r_[0:2000, 2400 : made.time.size]
    with refused("voltage-hole"):
        read_loops({name: values[kept] for name, values in columns(made).items()})


def test_constant_voltage_is_refused() -> None:
    """A disconnected channel is refused."""
    made = record()
    with refused("voltage-inaccurate"):
        read_loops(columns(made) | {"u_V": np.full(made.time.size, 0.25)})


def test_a_sense_coil_that_is_named_as_the_coil_is_refused() -> None:
    made = record(is_sense=True)
    with refused("voltage-of-sense-coil u_V: the turns"):
        read_loops(columns(made), schedule="none")
    turns = {"turns": 20, "sense_turns": 20}
    read_loops(columns(made), schedule="none", columns={"u_V": "u_sense_V"}, constants=turns)


def test_sense_coil_is_referred_to_the_turns_of_the_coil() -> None:
    """The flux of a sense coil is multiplied by the ratio of the turns, which must be stated."""
    made = record(BOTH_SIGNS, is_sense=True)
    with refused("turns-missing"):
        read_loops(columns(made, "u_sense_V"))
    loops = read_loops(
        columns(made, "u_sense_V"), constants={"turns": 260, "sense_turns": 20}, schedule="none"
    )
    assert made.error(loops.loops[0].output / 13.0) < 0.1


@pytest.mark.parametrize("turns", [{"turns": 260}, {"turns": 260, "sense_turns": 0}])
def test_incomplete_turns_are_refused(turns: dict[str, float]) -> None:
    """Both numbers of turns must be given and above zero."""
    with refused("turns-missing"):
        read_loops(columns(record(is_sense=True), "u_sense_V"), constants=turns)


def test_both_voltages_prefer_the_sense_coil_with_known_turns() -> None:
    """Without turns, the voltage of the coil itself is used."""
    made, sense = record(), record(is_sense=True)
    table = columns(made) | {"u_sense_V": sense.voltage}
    assert "resistance" in read_loops(table).notes[1]
    loops = read_loops(table, constants={"turns": 1, "sense_turns": 1})
    assert not any("resistance" in note for note in loops.notes)


@pytest.mark.parametrize(
    "header",
    [
        "Time [s],Current [A],Voltage [V]",
        "Zeit [s],Spulenstrom [A],Spulenspannung [V]",
        "t_s,I_A,u_V,counter",
        "Temps (s),Courant (A),Tension (V)",
    ],
)
def test_headers_of_loggers_are_understood(tmp_path: Path, header: str) -> None:
    """A time, a current and a voltage are a record of a coil, whatever the language."""
    made = record()
    values = [*columns(made).values(), np.arange(float(made.time.size))][: header.count(",") + 1]
    loops = read_loops(write(tmp_path / "coil.csv", header, *values))
    assert loops.output == QUANTITIES["flux_linkage"]
    assert made.error(loops.loops[0].output) < 0.2


def test_german_decimals_blank_lines_and_milliseconds_are_understood(tmp_path: Path) -> None:
    """Decimal commas, remarks above the header and a coarse clock in ms do not matter."""
    made = record()
    rows = zip(np.round(1e3 * made.time, -1), made.current, 1e3 * made.voltage, strict=True)
    lines = [";".join(f"{value:.9g}" for value in row).replace(".", ",") for row in rows]
    path = tmp_path / "coil.csv"
    path.write_text(
        "\n".join(["Messung 3", "", "Zeit [ms];Strom [A];Spannung [mV]", *lines]), encoding="utf-8"
    )
    assert made.error(read_loops(path).loops[0].output) < 0.25


def test_a_column_that_can_be_the_output_is_asked_about() -> None:
    """A voltage of an unknown sensor keeps the question for the output, with the option."""
    made = record()
    table = columns(made) | {"Load cell [V]": made.flux**2}
    with refused("column-missing") as caught:
        read_loops(table)
    assert "u_V=u_V" in in_commands(caught.value)
    assert made.error(read_loops(table, columns={"u_V": "u_V"}).loops[0].output) < 0.2


def test_times_are_asked_for() -> None:
    """Without times, the message says that a voltage of a coil needs them."""
    made = record()
    with refused("column-missing") as caught:
        read_loops({"I_A": made.current, "u_V": made.voltage})
    assert "'t_s'" in in_commands(caught.value)


def test_a_force_takes_precedence_over_the_voltage() -> None:
    """A table with a force is a loop of the force."""
    made = record()
    assert read_loops(columns(made) | {"F_N": made.flux**2}).output == QUANTITIES["force"]


def test_gaps_of_file_names_columns_and_labels_are_used(tmp_path: Path) -> None:
    """Files, gaps of a column and labels are integrated separately."""
    records = {gap: record(seed=seed) for seed, gap in enumerate((0.3, 0.5, 0.8))}
    paths = [write(tmp_path / f"coil_{gap}mm.csv", "t_s,I_A,u_V", *columns(made).values())
             for gap, made in records.items()]  # fmt: skip
    gaps = np.repeat(list(records), [made.time.size for made in records.values()])
    joined = {name: np.concatenate([columns(made)[name] for made in records.values()])
              for name in ("t_s", "I_A", "u_V")}  # fmt: skip
    by_column = read_loops(joined | {"gap_mm": gaps})
    by_name = read_loops(paths)
    for loops in (by_column, by_name):
        assert loops.schedule_values == pytest.approx((3e-4, 5e-4, 8e-4))
        for loop, made in zip(loops, records.values(), strict=True):
            assert made.error(loop.output) < 0.25
    labelled = read_loops(joined | {"loop": gaps}, schedule="none")
    assert [
        made.error(loop.output) < 0.25 for loop, made in zip(labelled, records.values(), strict=True)
    ] == [True] * 3


def test_file_names_of_a_piezo_are_no_gaps(tmp_path: Path) -> None:
    """A voltage that drives a displacement does not make a length in the file name a gap."""
    phase = np.linspace(0.0, 12.0, 600)
    columns_of_stack = (50.0 - 50.0 * np.cos(phase), 9.0 - 9.0 * np.cos(phase - 0.1))
    paths = [write(tmp_path / f"stack_{name}mm.csv", "u_V,x_um", *columns_of_stack[:1], size * columns_of_stack[1])
             for name, size in (("0.3", 1.0), ("0.5", 1.01))]  # fmt: skip
    assert read_loops(paths).schedule is None


def test_a_demagnetising_sine_gives_the_zero() -> None:
    """The record after a decaying sine begins at zero flux, demagnetised."""
    made = record((0.0, *DEMAGNETISING, 0.0, *NESTED[1:], 1.0, 1.0, 0.0), is_sense=True)
    loop = read_loops(columns(made, "u_sense_V"), constants={"turns": 1, "sense_turns": 1}).loops[0]
    assert loop.history.kind == "demagnetised"
    flux = made.flux[-loop.n :]
    assert abs(loop.input[0]) < 0.02 * loop.input.max()
    assert np.max(np.abs(loop.output - (flux - flux[0]))) < 0.01 * flux.max()


@pytest.mark.parametrize("points", [np.repeat((1.0, 0.5, 0.1), 4), 0.8 ** np.arange(16)])
def test_cycles_of_decreasing_size_are_kept(points: FloatArray) -> None:
    """Repeated cycles do not demagnetise, and a sine at the end of a record is part of the record."""
    tips = points * np.resize((1.0, -1.0), points.size)
    made = record((0.0, *BOTH_SIGNS[1:5], *tips, 0.0), is_sense=True)
    loop = read_loops(
        columns(made, "u_sense_V"), constants={"turns": 1, "sense_turns": 1}, schedule="none"
    ).loops[0]
    assert loop.n == made.time.size


def test_symmetry_gives_the_zero_of_cycles_with_both_signs() -> None:
    """A record that begins at the tip of a cycle is centred."""
    made = record((1.0, *(-1.0, 1.0) * 3), rest=0.5, is_sense=True)
    loops = read_loops(columns(made, "u_sense_V"), constants={"turns": 1, "sense_turns": 1})
    loop = loops.loops[0]
    assert loop.output.max() == pytest.approx(-loop.output.min(), rel=0.01)
    assert not any("remanent" in note for note in loops.notes)


def test_unknown_remanence_is_said() -> None:
    """A settled record of one sign starts at zero, with a note about the unknown remanence."""
    loops = read_loops(columns(record()), history="settled")
    assert loops.loops[0].output[0] == 0.0
    assert any("remanent flux there is unknown" in note for note in loops.notes)
    assert not any("remanent" in note for note in read_loops(columns(record()), history="demagnetised").notes)


def test_equal_curves_are_found_inside_larger_ones() -> None:
    """After a minor loop, the iron continues on the larger curve."""
    points = (0.0, 5.0, 1.0, 3.0, 1.0, 3.0, 0.0, 5.0, 0.0)
    drive = np.concatenate([np.linspace(a, b, 41)[:-1] for a, b in pairwise(points)])
    found = [[(drive[s.start], drive[s.stop - 1]) for s in curve] for curve in find_curves(drive)]
    largest = next(curve for curve in found if curve[0][0] == 5.0)
    assert [round(start) for start, _ in largest] == [5, 1, 5]
    assert any([round(start) for start, _ in curve] == [1, 1] for curve in found)


def test_the_first_rise_is_no_repeated_curve() -> None:
    """The history before the record is unknown, so its first rise is compared with nothing."""
    drive = np.tile(np.concatenate([np.linspace(0, 1, 40), np.linspace(1, 0, 40)[1:]]), 3)
    assert all(stretch.start > 0 for curve in find_curves(drive) for stretch in curve)


@pytest.mark.parametrize("seed", range(6))
def test_drift_of_an_integrator_is_found_from_equal_states(seed: int) -> None:
    """The step 'drift' removes 0.6 % of drift from a column of flux linkage to 0.15 %."""
    made = record(seed=seed, is_play=bool(seed % 2))
    largest, rng = float(made.flux.max()), np.random.default_rng(seed)
    share = made.time / made.time[-1]
    noisy = made.flux + 0.006 * largest * share + 1e-3 * largest * rng.normal(size=share.size)
    loop = Loop("1", made.current, noisy, None, made.time)
    loops = Loops((loop,), QUANTITIES["current"], QUANTITIES["flux_linkage"])
    assert estimate_drift(loop, loops.output) == pytest.approx(0.006 * largest, abs=0.0015 * largest)
    cleaned = clean(loops, ["drift"])
    assert cleaned.repairs[0].startswith("drift:")


def test_noise_is_no_drift() -> None:
    """A column of flux linkage without drift stays unchanged."""
    made = record()
    noise = 1e-3 * made.flux.max() * np.random.default_rng(3).normal(size=made.flux.size)
    loop = Loop("1", made.current, made.flux + noise, None, made.time)
    assert estimate_drift(loop, QUANTITIES["flux_linkage"]) == 0.0


def test_holds_of_cycles_with_both_signs_are_not_another_gap(tmp_path: Path) -> None:
    """Holds at one of the two tips do not make equal cycles look like cycles of another gap."""
    made = record((0.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 0.0))
    path = write(tmp_path / "coil.csv", "t_s,I_A,psi_Wb", made.time, made.current, made.flux)
    assert len(read_loops(path)) == 1
