"""Files in the layouts of loggers and oscilloscopes, made from a record with known values.

Each function writes one layout with times in s and two channels. The layouts follow the manuals and
public sample files of the manufacturers; the values are synthetic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst.support.numeric import FloatArray

N = 300
TIMES: FloatArray = np.linspace(-0.1, 0.199, N, dtype=np.float64)
CURRENT: FloatArray = 2.0 * np.sin(2.0 * np.pi * (TIMES + 0.1) / 0.15) + 1e-9
FORCE: FloatArray = 3.0 * CURRENT + 0.4 * np.cos(2.0 * np.pi * (TIMES + 0.1) / 0.15)
START, STEP = TIMES[0], 1e-3


@dataclass(frozen=True)
class Export:
    """A file: its name, its text, and the option that maps its channels."""

    name: str
    text: str
    columns: dict[str, str]
    encoding: str = "utf-8"

    @property
    def reading(self) -> dict[str, Any]:
        """Return the options of a user: the mapping of the channels, and scales from volts."""
        scale = {name: 1.0 for name, target in self.columns.items() if target}
        return {"columns": self.columns, "scale": scale}


def _rows(sign: str = ",", comma: bool = False, tail: str = "", *, times: bool = True) -> str:
    """Return rows of time, current and force."""
    columns = ((TIMES,) if times else ()) + (CURRENT, FORCE)
    lines = [sign.join(f"{value:.9e}" for value in row) + tail for row in zip(*columns, strict=True)]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


def _lines(*lines: str) -> str:
    return "\n".join(lines) + "\n"


CHANNELS = {"CH1": "I_A", "CH2": "F_N"}


def rigol_counter() -> Export:
    """DS1000Z: counter, start and increment in the header."""
    body = "".join(f"{n},{i:.6e},{f:.6e},,\n" for n, (i, f) in enumerate(zip(CURRENT, FORCE, strict=True)))
    head = _lines("X,CH1,CH2,Start,Increment,", f"Sequence,Volt,Volt,{START:.6e},{STEP:.6e}")
    return Export("rigol.csv", head + body.replace(",,\n", ",\n"), CHANNELS)


def rigol_t0() -> Export:
    """MSO5000: start and increment as fields of the header, no column of times."""
    head = f"CH1V,CH2V,t0 ={START:.6e}, tInc = {STEP:.6e},\n"
    return Export("rigol5.csv", head + _rows(tail=",,,", times=False), CHANNELS)


def rigol_time() -> Export:
    """DHO800: the times are a column."""
    head = f"Time(s),CH1(V),CH2(V),t0 = {START:.6e}, tInc = {STEP:.6e}\n"
    return Export("dho.csv", head + _rows(tail=",,"), CHANNELS)


def rigol_old() -> Export:
    """DS1000E: channels in brackets."""
    return Export("e.csv", "Time,X(CH1),X(CH2)\nSecond,Volt,Volt\n" + _rows(), CHANNELS)


def tektronix_beside() -> Export:
    """TDS2000: settings in the first columns, one block for each channel."""
    settings = ["Record Length,{n},Points", "Sample Interval,1e-3,s", "Trigger Point,100,Samples", ",,",
                "Source,{name},", "Vertical Units,V,", "Vertical Scale,1.0,", "Horizontal Units,s,",
                "Model Number,TDS2024,"]  # fmt: skip
    lines = []
    for row in range(N):
        beside = settings[row] if row < len(settings) else ",,"
        lines.append("".join(
            f"{beside.format(n=N, name=name)},{TIMES[row]:.9e},{values[row]:.9e},,"
            for name, values in (("CH1", CURRENT), ("CH2", FORCE))))  # fmt: skip
    return Export("tek.csv", _lines(*lines), CHANNELS)


def tektronix_block() -> Export:
    """MSO and MDO: a block of settings, labels, then names."""
    head = _lines("Model,MDO3024", "Firmware Version,1.30", "", "Point Format,Y,,Y,",
                  "Horizontal Units,s,,s,", "Sample Interval,1e-3,,1e-3,", "Record Length,300,,300,",
                  "Vertical Units,A,,V,", "Vertical Scale,1,,5,", ",,,,", "Label,coil current,,load cell,",
                  "TIME,CH1,,CH2,")  # fmt: skip
    body = "".join(f"{t:.9e},{i:.9e},,{f:.9e},\n" for t, i, f in zip(TIMES, CURRENT, FORCE, strict=True))
    return Export("mso.csv", head + body, CHANNELS)


def keysight() -> Export:
    """InfiniiVision: channels are numbers."""
    return Export("scope_0.csv", "x-axis,1,2\nsecond,Volt,Volt\n" + _rows(), CHANNELS)


def siglent() -> Export:
    """SDS1000X-E: settings, then the source of each column."""
    head = _lines("Record Length,Analog:300", "Sample Interval,0.001", "Vertical Units,CH1:V,CH2:V",
                  "Vertical Scale,CH1:1.0,CH2:5.0", "Horizontal Units,s", "Model Number,SDS1104X-E",
                  "Source,CH1,CH2", "Second,Volt,Volt")  # fmt: skip
    return Export("sds.csv", head + _rows(), CHANNELS)


def rohde_schwarz() -> Export:
    """RTB2000: units in words."""
    return Export("rtb.csv", "in s,C1 in V,C2 in V\n" + _rows(), {"C1": "I_A", "C2": "F_N"})


def picoscope() -> Export:
    """PicoScope: units in brackets, then a blank line."""
    body = "".join(
        f"{1e3 * t:.8f},{i:.8f},{1e3 * f:.8f}\n" for t, i, f in zip(TIMES, CURRENT, FORCE, strict=True)
    )
    head = "Time,Channel A,Channel B\n(ms),(V),(mV)\n\n"
    return Export("pico.csv", head + body, {"Channel A": "I_A", "Channel B": "F_mN"})


def yokogawa() -> Export:
    """DL850: quoted settings, a row each; the rows of data begin with an empty field."""
    head = _lines('"Model","DL850"', '"BlockNumber",1', '"TraceName","Current   ","Force     "',
                  '"BlockSize",300,300', '"VUnit","A","N"', '"SampleRate",1000,1000',
                  f'"HResolution",{STEP:.7e},{STEP:.7e}', f'"HOffset",{START:.7e},{START:.7e}',
                  '"HUnit","s","s"', '"Date","2026/11/28","2026/11/28"', '"Time","10:00:00.00","10:00:00.00"',
                  "")  # fmt: skip
    body = "".join(f",{i:.9e},{f:.9e}\n" for i, f in zip(CURRENT, FORCE, strict=True))
    return Export("dl850.csv", head + body, {})


def hioki() -> Export:
    """Memory HiCorder: quoted remarks, names with units, times in s."""
    head = _lines('"HIOKI MR8847","V1.0"', '"Title comment",""', '"Trigger Time","\'26-11-28 10:00:00"',
                  '"CH1-1","Current","1 A/div"', '"CH2-1","Force","5 N/div"',
                  '"Time[s]","Current[A]","Force[N]"')  # fmt: skip
    return Export("hioki.csv", head + _rows(), {})


def lecroy() -> Export:
    """WavePro with two traces in one file."""
    head = _lines("LECROYWP725Zi,44444,Waveform", "Segments,1,SegmentSize,300", "Segment,TrigTime,TimeSinceSegment1",
                  "#1,28-Nov-2026 10:00:00,0", "Time,Ampl C1,Ampl C2")  # fmt: skip
    return Export("c1.csv", head + _rows(), {"Ampl C1": "I_A", "Ampl C2": "F_N"})


def catman() -> Export:
    """Catman ASCII: names with units, then channels and rates."""
    head = _lines("HBM_CATMAN_DATAFILE_40", "5.3.1", "CHANNELS=3", "MAXLENGTH=300", "DATE=28.11.2026",
                  "Time  1 - default sample rate [s]\tCurrent [A]\tForce [N]", "00:00:00\tMX840B_0 CH1\tMX840B_0 CH2",
                  "SR = 1000 Hz\tSR = 1000 Hz\tSR = 1000 Hz")  # fmt: skip
    return Export("catman.asc", head + _rows("\t", comma=True), {}, "latin-1")


def dewesoft() -> Export:
    """Dewesoft text export."""
    head = _lines("File name: loop.dxd", "Start time: 28.11.2026 10:00:00", "Number of channels: 3",
                  "Sample rate: 1000", "Store type: always fast", "", "Data1", "",
                  "Time (s);Current (A);Force (N)")  # fmt: skip
    return Export("dewesoft.txt", head + _rows(";", comma=True), {}, "utf-8-sig")


def famos() -> Export:
    """Export of imc FAMOS: names, then units, with tab and decimal comma."""
    return Export("imc.txt", "Time\tCurrent\tForce\ns\tA\tN\n" + _rows("\t", comma=True), {}, "latin-1")


def comsol() -> Export:
    """COMSOL: comments with a percent sign; the last one contains the column names."""
    head = _lines("% Model:              actuator.mph", "% Version:            COMSOL 6.2.0.290",
                  "% Table:              Table 1 - Global Evaluation 1",
                  "% Time (s)             Current (A)               Force (N)")  # fmt: skip
    return Export("comsol.txt", head + _rows("   "), {})


def _lvm(sign: str, comma: bool, kind: str, rows: Iterable[str], names: str, segments: str = "") -> str:
    word, point = {"\t": "Tab", ",": "Comma"}[sign], "," if comma else "."
    head = ["LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", f"Separator\t{word}",
            f"Decimal_Separator\t{point}", "Multi_Headings\tYes", f"X_Columns\t{kind}", "Time_Pref\tRelative",
            "Date\t2026/11/28", "Time\t10:00:00", "***End_of_Header***", ""]  # fmt: skip
    zero = f"{START:.6e}"
    block = ["Channels\t2", "Samples\t300\t300", "Date\t2026/11/28\t2026/11/28", "Time\t10:00:00\t10:00:00",
             "Y_Unit_Label\tA\tN", "X_Dimension\tTime\tTime", f"X0\t{zero}\t{zero}",
             f"Delta_X\t{STEP:.6e}\t{STEP:.6e}", "***End_of_Header***", names]  # fmt: skip
    text = _lines(*head, *block).replace("\t", sign) + "".join(rows)
    return text.replace(".", ",") if comma else text


def labview_no() -> Export:
    """LabVIEW without a column of times."""
    rows = [f"\t{i:.9f}\t{f:.9f}\n" for i, f in zip(CURRENT, FORCE, strict=True)]
    return Export("no.lvm", _lvm("\t", True, "No", rows, "X_Value\tCurrent\tForce\tComment"), {})


def labview_one() -> Export:
    """LabVIEW with one column of times, commas between fields."""
    rows = [f"{t:.9f},{i:.9f},{f:.9f}\n" for t, i, f in zip(TIMES, CURRENT, FORCE, strict=True)]
    return Export("one.lvm", _lvm(",", False, "One", rows, "X_Value\tCurrent\tForce\tComment"), {})


def labview_multi() -> Export:
    """LabVIEW with the times of each channel."""
    rows = [f"{t:.9f}\t{i:.9f}\t{t:.9f}\t{f:.9f}\n" for t, i, f in zip(TIMES, CURRENT, FORCE, strict=True)]
    names = "X_Value\tCurrent\tX_Value\tForce\tComment"
    return Export("multi.lvm", _lvm("\t", False, "Multi", rows, names), {})


def time_stamps() -> Export:
    """A logger with a date and a time of day, before midnight and after it."""
    seconds = 86399.9 + 1e-3 * np.arange(N)
    lines = [
        f"{'2026-11-28' if s < 86400.0 else '2026-11-29'} {int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:"
        f"{s % 60.0:06.3f},{i:.9f},{f:.9f}"
        for s, i, f in zip(np.round(seconds, 3), CURRENT, FORCE, strict=True)
    ]
    return Export("stamps.csv", _lines("Timestamp,I [A],F [N]", *lines), {})


def time_of_day() -> Export:
    """A German logger: times of day with a decimal comma and a separate date."""
    lines = [f"28.11.2026;10:00:{0.001 * n:06.3f};{CURRENT[n]:.9f};{FORCE[n]:.9f}".replace(".", ",")
             for n in range(N)]  # fmt: skip
    text = _lines("Datum;Zeit;I [A];F [N]", *lines).replace("28,11,2026", "28.11.2026")
    return Export("uhr.csv", text, {}, "latin-1")


def plain_utf16() -> Export:
    """A spreadsheet that was saved as Unicode text."""
    return Export("unicode.txt", "t [s]\tI [A]\tF [N]\n" + _rows("\t", comma=True), {}, "utf-16")


def names_below_units() -> Export:
    """Units above the names."""
    return Export("above.csv", "s;A;N\nt;I;F\n" + _rows(";", comma=True, tail=";"), {})


def quoted() -> Export:
    """Quoted fields, a comma in a name, a trailing comma."""
    body = "".join(f'"{t:.9f}","{i:.9f}","{f:.9f}",\n' for t, i, f in zip(TIMES, CURRENT, FORCE, strict=True))
    return Export("quoted.csv", '"t (s)","Current (A)","Force (N)",\n' + body, {})


def aixacct(tables: int = 1) -> Export:
    """AixPlorer: settings and a table for each measurement; the polarisation is in uC/cm2."""
    head = ["DynamicHysteresis", "SampleName: PZT 5A", "Area [mm2]: 0.5", "Thickness [nm]: 200", ""]
    for number in range(1, tables + 1):
        head += [f"Table {number}", f"Measurement number: {number}", "Hysteresis Frequency [Hz]: 100",
                 "Hysteresis Amplitude [V]: 2", "", "Time [s]\tV+ [V]\tI1 [A]\tP1 [uC/cm2]\tD1 [nm]"]  # fmt: skip
        head += [f"{t:.9e}\t{number * i:.9e}\t1e-3\t0.1\t{1e9 * f:.9e}" for t, i, f
                 in zip(TIMES, CURRENT, FORCE, strict=True)]  # fmt: skip
        head += [""]
    columns = {"V+ [V]": "u_V", "D1 [nm]": "x_nm", "P1 [uC/cm2]": ""}
    return Export("hysteresis.dat", _lines(*head), columns)


def labview_segments(pause: float = 0.0) -> Export:
    """LabVIEW: a record in two parts, or two records with a pause between them."""
    text, half_count = labview_no().text, N // 2
    lines = text.split("\n")
    begin, data = lines.index("Channels\t2"), len(lines) - 1 - N
    zero = lines[next(n for n, line in enumerate(lines) if line.startswith("X0"))]
    later = f"{START + half_count * STEP + pause:.6e}".replace(".", ",")
    block = [f"X0\t{later}\t{later}" if line == zero else line for line in lines[begin:data]]
    parts = [*lines[: data + half_count], "", *block, *lines[data + half_count :]]
    return Export("parts.lvm", "\n".join(parts), {})


LAYOUTS: tuple[Callable[[], Export], ...] = (
    rigol_counter, rigol_t0, rigol_time, rigol_old, tektronix_beside, tektronix_block, keysight, siglent,
    rohde_schwarz, picoscope, yokogawa, hioki, lecroy, catman, dewesoft, famos, comsol, labview_no,
    labview_one, labview_multi, time_stamps, time_of_day, plain_utf16, names_below_units, quoted,
    aixacct, labview_segments,
)  # fmt: skip
