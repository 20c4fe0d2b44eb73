"""Draw magnets, and write their flux linkage and force as programs for field simulation do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from anhyst.support.numeric import FloatArray

MU_0 = 4e-7 * np.pi


class DrawnMagnet:
    """A saturating iron without hysteresis, two gaps with fringing, and leakage parallel to them."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.turns, self.area = int(rng.integers(80, 600)), 10.0 ** rng.uniform(-4.2, -3.2)
        self.length, self.saturation = rng.uniform(0.05, 0.25), rng.uniform(1.4, 2.1)
        self.permeability, self.knee = 10.0 ** rng.uniform(2.7, 3.8), rng.uniform(1.5, 5.0)
        self.fringing = rng.uniform(0.1, 1.2) / np.sqrt(self.area)
        self.leakage = rng.uniform(0.02, 0.25) * MU_0 * self.area / 1e-3
        smallest, largest = rng.uniform(0.15e-3, 0.4e-3), rng.uniform(0.9e-3, 2.5e-3)
        count = int(rng.integers(4, 9))
        self.gaps = np.array([float(f"{gap:.3g}") for gap in np.geomspace(smallest, largest, count)])
        flux = np.array([self.saturation * rng.uniform(0.55, 1.05) * self.area])
        middle = float(self.gaps[count // 2])
        self.currents = np.linspace(0.0, 1.0, int(rng.integers(13, 32)))
        self.currents = self.currents * float(f"{self.current(flux, middle)[0]:.2g}")

    def current(self, flux: FloatArray, gap: float) -> FloatArray:
        """Return the current of a flux in the iron, A."""
        share = np.abs(flux) / (self.area * self.saturation)
        field_strength = (
            self.saturation / (MU_0 * self.permeability) * share * (1.0 + 3.0 * share ** (2.0 * self.knee))
        )
        beyond = np.maximum(share - 1.0, 0.0)
        field_strength += self.saturation * beyond / (2.0 * MU_0) * (1.0 - np.exp(-((beyond / 0.05) ** 2)))
        drive = field_strength * self.length + np.abs(flux) / self._permeance(gap)
        return np.asarray(np.sign(flux) * drive / self.turns)

    def _permeance(self, gap: float) -> float:
        return float(MU_0 * self.area / (2.0 * gap) * (1.0 + self.fringing * gap) + self.leakage)

    def flux(self, current: FloatArray, gap: float) -> FloatArray:
        """Return the flux in the iron, Wb, by bisection."""
        low, high = np.zeros_like(current), np.full_like(current, 4.0 * self.area * self.saturation)
        for _ in range(80):
            middle = 0.5 * (low + high)
            is_low = self.current(middle, gap) < np.abs(current)
            low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
        return np.asarray(np.sign(current) * 0.5 * (low + high))

    def psi(self, current: FloatArray, gap: float) -> FloatArray:
        """Return the flux linkage, Wb."""
        return self.turns * self.flux(current, gap)

    def force_of_flux(self, flux: FloatArray, gap: float) -> FloatArray:
        """Return the attraction at a flux, N: from the energy of the gap."""
        drop = flux / self._permeance(gap)
        return np.asarray(0.5 * drop * drop * MU_0 * self.area / (2.0 * gap * gap))

    def force(self, current: FloatArray, gap: float) -> FloatArray:
        """Return the attraction, N."""
        return self.force_of_flux(self.flux(current, gap), gap)


@dataclass
class Table:
    """The true points of a table in SI units, shape (gaps, currents)."""

    gaps: FloatArray
    currents: FloatArray
    psi: FloatArray
    force: FloatArray
    rng: np.random.Generator
    length_unit: tuple[str, float] = ("mm", 1e3)
    current_unit: tuple[str, float] = ("A", 1.0)
    is_stroke: bool = False
    missing: set[tuple[int, int]] = field(default_factory=set)  # points without a value

    @property
    def positions(self) -> FloatArray:
        """The position of each gap in the unit of the file."""
        gaps = self.gaps.max() - self.gaps if self.is_stroke else self.gaps
        return np.array([float(f"{self.length_unit[1] * gap:.9g}") for gap in gaps])

    @property
    def file_currents(self) -> FloatArray:
        """The currents in the unit of the file."""
        return np.array([float(f"{self.current_unit[1] * value:.12g}") for value in self.currents])

    def rows(self, *, is_shuffled: bool = True) -> Iterator[tuple[float, float, float, float]]:
        """Yield current, position, flux linkage and force of each point, some of them twice."""
        points = [(g, n) for g in range(self.gaps.size) for n in range(self.currents.size)]
        points = [point for point in points if point not in self.missing]
        if is_shuffled and self.rng.random() < 0.5:
            self.rng.shuffle(points)
        if is_shuffled and self.rng.random() < 0.3:
            points += points[:3]
        for g, n in points:
            yield self.file_currents[n], self.positions[g], self.psi[g, n], self.force[g, n]


def draw_table(seed: int) -> Table:
    """Return the table of a drawn magnet with drawn units, direction and missing points."""
    rng = np.random.default_rng(seed + 1_000_000)
    magnet = DrawnMagnet(seed)
    psi = np.array([magnet.psi(magnet.currents, gap) for gap in magnet.gaps])
    force = np.array([magnet.force(magnet.currents, gap) for gap in magnet.gaps])
    length_unit = [("mm", 1e3), ("m", 1.0), ("um", 1e6)][rng.integers(3)]
    current_unit = [("A", 1.0), ("mA", 1e3), ("kA", 1e-3)][rng.integers(3)]
    table = Table(magnet.gaps, magnet.currents, psi, force, rng, length_unit, current_unit)
    table.is_stroke = bool(rng.random() < 0.4)
    if rng.random() < 0.5:
        table.missing = {
            (int(rng.integers(magnet.gaps.size)), int(rng.integers(1, magnet.currents.size)))
            for _ in range(3)
        }
    return table


def _position_name(table: Table) -> str:
    names = ["x", "position", "stroke"] if table.is_stroke else ["gap", "x", "d"]
    return names[table.rng.integers(len(names))]


def write_femm(table: Table, path: Path) -> Path:
    """Write the file of a Lua script with `mo_getcircuitproperties`: separated by tabs or commas."""
    sign = ["\t", ","][table.rng.integers(2)]
    force_sign = [1.0, -1.0][table.rng.integers(2)]
    position, unit = _position_name(table), table.length_unit[0]
    names = [
        [f"I ({table.current_unit[0]})", f"{position} ({unit})", "Flux linkage (Wb)", "Force (N)"],
        [f"current [{table.current_unit[0]}]", f"{position}_{unit}", "lambda [Wb]", "Fy [N]"],
    ][table.rng.integers(2)]
    lines = [sign.join(names)]
    lines += [sign.join(repr(float(v)) for v in (i, x, p, force_sign * f)) for i, x, p, f in table.rows()]
    target = path / ("femm.csv" if sign == "," else "femm.txt")
    target.write_text("\n".join(lines) + "\n")
    return target


def write_comsol(table: Table, path: Path) -> Path:
    """Write a table of COMSOL: lines of `%`, then columns of a fixed width or separated by commas."""
    position, unit = _position_name(table), table.length_unit[0]
    names = [
        f"I0 ({table.current_unit[0]})", f"{position} ({unit})",
        "Coil concatenated flux (Wb)", "Electromagnetic force, y component (N)",
    ]  # fmt: skip
    is_csv = table.rng.random() < 0.4
    force_sign = [1.0, -1.0][table.rng.integers(2)]
    lines = [
        "% Model:              magnet.mph", "% Version:            COMSOL 6.1.0.357",
        "% Date:               Jul 17 2024, 02:34", "% Table:              Table 1 - Global Evaluation 1",
    ]  # fmt: skip
    if is_csv:
        lines = [text.replace("% ", "% ").replace(":  ", ":,", 1) for text in lines]
        lines.append("% " + ",".join(f'"{name}"' if "," in name else name for name in names))
    else:
        lines.append("% " + "".join(f"{name:<26} " for name in names).rstrip())
    for i, x, p, f in table.rows():
        values = [repr(float(value)) for value in (i, x, p, force_sign * f)]
        lines.append(",".join(values) if is_csv else "".join(f"{value:<26} " for value in values).rstrip())
    target = path / ("comsol.csv" if is_csv else "comsol.txt")
    target.write_text("\n".join(lines) + "\n")
    return target


def write_comsol_spreadsheet(table: Table, path: Path) -> Path:
    """Write COMSOL's form with one column for each position."""
    unit, position = table.length_unit[0], _position_name(table)
    header = [f"I0 ({table.current_unit[0]})"]
    header += [
        f"Coil concatenated flux (Wb) @ {position}={value!r} {unit}" for value in table.positions.tolist()
    ]
    lines = ["% Model:,magnet.mph", "% Version:,COMSOL 6.1.0.357", "% " + ",".join(header)]
    lines += _matrix_rows(table, table.psi, ",")
    target = path / "spreadsheet.csv"
    target.write_text("\n".join(lines) + "\n")
    return target


def write_jmag(table: Table, path: Path) -> Path:
    """Write titles and one section for each position, with names above its rows."""
    position, unit = _position_name(table), table.length_unit[0]
    lines = ["Title,Flux linkage and force", "Study,magnet_static", f"Number of cases,{table.gaps.size}", ""]
    order = table.rng.permutation(table.gaps.size)
    for number, g in enumerate(order, start=1):
        lines += [
            f"Case {number}: {position} = {table.positions[g]!r} {unit}".replace("np.float64(", "").replace(
                ")", ""
            )
        ]
        lines += [f"Current({table.current_unit[0]}),Flux linkage(Wb),Force(N)"]
        for n, value in enumerate(table.file_currents.tolist()):
            if (g, n) not in table.missing:
                lines.append(f"{value!r},{float(table.psi[g, n])!r},{float(table.force[g, n])!r}")
        lines.append("")
    target = path / "jmag.csv"
    target.write_text("\n".join(lines) + "\n")
    return target


def write_elmer(table: Table, path: Path) -> Path:
    """Write the numbers of `SaveScalars`, and the names of its columns to a second file."""
    table.length_unit, table.current_unit = ("m", 1.0), ("A", 1.0)
    names = [
        "air gap" if not table.is_stroke else "stroke",
        "coil current",
        "flux linkage",
        "magnetic force 2",
    ]
    text = ["Metadata for SaveScalars file: scalars.dat", "Elmer version: 9.0", ""]
    text += ["Variables in columns of matrix: scalars.dat"]
    text += [f"{n:4d}: res: {name}" for n, name in enumerate(names, start=1)]
    rows = [f"  {x:.12E}  {i:.12E}  {p:.12E}  {-f:.12E}" for i, x, p, f in table.rows()]
    (path / "scalars.dat.names").write_text("\n".join(text) + "\n")
    target = path / "scalars.dat"
    target.write_text("\n".join(rows) + "\n")
    return target


def write_mat(table: Table, path: Path) -> Path:
    """Write a structure of MATLAB with matrices over current and position."""
    from scipy.io import savemat

    unit = table.length_unit[0]
    current, position = np.meshgrid(table.file_currents, table.positions)
    psi = table.psi.copy()
    for point in table.missing:
        psi[point] = np.nan
    name = "x" if table.is_stroke else "gap"
    fields = {
        f"I_{table.current_unit[0]}": current,
        f"{name}_{unit}": position,
        "psi_Wb": psi,
        "F_N": table.force,
    }
    target = path / "map.mat"
    savemat(target, {"FluxMap": fields})
    return target


def write_long(table: Table, path: Path) -> Path:
    """Write one row for each point, also with a decimal comma."""
    name = "x" if table.is_stroke else "gap"
    lines = [f"I_{table.current_unit[0]},{name}_{table.length_unit[0]},psi_Wb,F_N"]
    lines += [",".join(repr(float(value)) for value in row) for row in table.rows()]
    if table.missing and table.rng.random() < 0.5:
        g, n = next(iter(table.missing))
        lines.append(f"{table.file_currents[n]},{table.positions[g]},NaN,NaN")
    text = "\n".join(lines) + "\n"
    target = path / "table.csv"
    target.write_text(text.replace(",", ";").replace(".", ",") if table.rng.random() < 0.4 else text)
    return target


def write_matrix(table: Table, path: Path) -> Path:
    """Write a matrix with a row for each current and a column for each position, or the reverse."""
    sign = [",", ";", "\t"][table.rng.integers(3)]
    name, unit = "x" if table.is_stroke else "gap", table.length_unit[0]
    current, positions = f"I_{table.current_unit[0]}", table.positions.tolist()
    kind = int(table.rng.integers(4))
    if kind == 0:
        lines = [sign.join([current, *(f"psi_Wb_{value!r}{unit}" for value in positions)])]
        if table.is_stroke:
            lines = [sign.join([current, *(f"psi_Wb @ x={value!r}{unit}" for value in positions)])]
    elif kind == 1:
        lines = ["psi_Wb", sign.join([f"{current}\\{name}_{unit}", *map(repr, positions)])]
    elif kind == 2:
        lines = [
            "# Flux linkage (Wb)",
            sign.join([current, *(f"{name}={value!r} {unit}" for value in positions)]),
        ]
    else:
        rows = [
            [repr(float(x)), *map(repr, psi)]
            for x, psi in zip(table.positions, table.psi.tolist(), strict=True)
        ]
        for g, n in table.missing:
            rows[g][1 + n] = "NaN"
        corner = f"{name} ({unit}) | I ({table.current_unit[0]})"
        lines = [
            "psi_Wb",
            sign.join([corner, *map(repr, table.file_currents.tolist())]),
            *map(sign.join, rows),
        ]
    lines += _matrix_rows(table, table.psi, sign) if kind < 3 else []
    text = "\n".join(lines) + "\n"
    target = path / "matrix.csv"
    target.write_text(text)
    return target


def _matrix_rows(table: Table, values: FloatArray, sign: str) -> list[str]:
    return [
        sign.join([
            repr(current),
            *("" if (g, n) in table.missing else repr(float(values[g, n])) for g in range(table.gaps.size)),
        ])
        for n, current in enumerate(table.file_currents.tolist())
    ]  # fmt: skip


WRITERS: dict[str, Callable[[Table, Path], Path]] = {
    "femm": write_femm,
    "comsol": write_comsol,
    "comsol-spreadsheet": write_comsol_spreadsheet,
    "jmag": write_jmag,
    "elmer": write_elmer,
    "mat": write_mat,
    "long": write_long,
    "matrix": write_matrix,
}
