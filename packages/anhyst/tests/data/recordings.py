"""Files in the formats of other programs: Simulink, ControlDesk, MATLAB, LabVIEW and Excel."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

PACKAGES = {
    ".mf4": "asammdf",
    ".tdms": "nptdms",
    ".h5": "h5py",
    ".parquet": "pyarrow",
    ".xlsx": "python_calamine",
}
"""Packages that read a format, in addition to SciPy."""


def loop(rate: float = 1000.0, begin: float = 0.0) -> tuple[Array, Array, Array]:
    """Times in s, current in A and force in N of two cycles with hysteresis."""
    times = begin + np.arange(int(2.0 * rate)) / rate
    current = 1.5 - 1.5 * np.cos(2.0 * np.pi * (times - begin))
    lagging = 1.5 - 1.5 * np.cos(2.0 * np.pi * (times - begin) - 0.1)
    return times, current, 40.0 * lagging**2


def structs(rows: Sequence[Mapping[str, Any]]) -> Array:
    """Return an array of structures for savemat, 1 by n."""
    table = np.empty((1, len(rows)), dtype=[(name, object) for name in rows[0]])
    for place, row in enumerate(rows):
        for name, value in row.items():
            table[0, place][name] = value
    return table


def control_desk(path: Path, *, slow_raster: float = 100.0, begin: float = 0.0) -> Path:
    """Write an export of ControlDesk: rows of samples, two rasters, paths of the model."""
    from scipy.io import savemat

    times, current, force = loop()
    slowly = begin + np.arange(int(2.0 * slow_raster)) / slow_raster
    channels = [
        ("Coil/Current", "Model Root/Coil/Current", "A", current, 1, "HostService"),
        ("Load cell", "Model Root/Load cell", "N", force, 1, "HostService"),
        ("Gap", "Model Root/Gap", "mm", np.full(slowly.size, 0.4), 2, "Slow"),
    ]
    recording = {
        "X": structs(
            [
                {"Name": "", "Type": 2.0, "Data": data[None, :], "Unit": "s", "Raster": raster}
                for data, raster in ((times, "HostService"), (slowly, "Slow"))
            ]
        ),
        "Y": structs(
            [
                {
                    "Name": name, "Path": where, "Type": 2.0, "Data": data[None, :], "Unit": unit,
                    "XIndex": np.int32(index), "Raster": raster,
                }
                for name, where, unit, data, index, raster in channels
            ]
        ),
        "Description": {"General": {"DateTime": "01/02/2024 10:11:12"}},
        "RTProgram": "magnet.sdf",
        "Capture": {"Length": 2000.0, "SamplingPeriod": 0.001, "Downsampling": 1.0},
    }  # fmt: skip
    savemat(path, {"exp_001": recording}, do_compression=True)
    return path


def with_time(path: Path) -> Path:
    """Write a structure with time, as the To Workspace and Scope blocks of Simulink do."""
    from scipy.io import savemat

    times, current, force = loop()
    signals = [
        {"values": values[:, None], "dimensions": 1.0, "label": label, "blockName": block}
        for values, label, block in (
            (current, "I_A", "magnet/Scope"), (force, "", "magnet/F_N"),
        )
    ]  # fmt: skip
    scope = {"time": times[:, None], "signals": structs(signals), "blockName": "magnet/Scope"}
    savemat(path, {"ScopeData": scope, "tout": times[:, None]})
    return path


def time_series(path: Path) -> Path:
    """Write structures with the fields of a timeseries, one for each channel, 1 by 1 by n samples."""
    from scipy.io import savemat

    times, current, force = loop()
    fields = {
        name: {
            "Name": name,
            "Time": times[:, None],
            "Data": values.reshape(1, 1, -1),
            "DataInfo": {"Units": unit},
            "TimeInfo": {"Units": "seconds"},
        }
        for name, values, unit in (("I", current, "A"), ("F", force, "N"))
    }
    savemat(path, {"log": fields})
    return path


def matlab_73(path: Path) -> Path:
    """Write a MAT file of version 7.3: transposed arrays, codes of texts, references."""
    import h5py

    times, current, force = loop()

    def put(group: Any, name: str, value: Any) -> Any:
        if isinstance(value, str):
            codes = np.frombuffer(value.encode("utf-16-le"), np.uint16)[:, None]
            dataset = group.create_dataset(name, data=codes)
            dataset.attrs["MATLAB_class"] = np.bytes_("char")
            dataset.attrs["MATLAB_int_decode"] = np.int32(2)
        elif isinstance(value, Mapping):
            dataset = group.create_group(name)
            dataset.attrs["MATLAB_class"] = np.bytes_("struct")
            for field, one in value.items():
                put(dataset, field, one)
        elif isinstance(value, list):  # an array of structures: references, field by field
            dataset = group.create_group(name)
            dataset.attrs["MATLAB_class"] = np.bytes_("struct")
            for field in value[0]:
                refs = [put(store, f"{name}{field}{n}", one[field]).ref for n, one in enumerate(value)]
                column = np.array(refs, dtype=h5py.ref_dtype)[:, None]
                dataset.create_dataset(field, data=column)
        else:
            array = np.asarray(value)
            is_logical = array.dtype == bool
            dataset = group.create_dataset(name, data=(array.astype(np.uint8) if is_logical else array).T)
            dataset.attrs["MATLAB_class"] = np.bytes_("logical" if is_logical else "double")
        return dataset

    with h5py.File(path, "w", userblock_size=512) as file:
        store = file.create_group("#refs#")
        put(file, "on", (current > 1.0)[:, None])
        put(file, "title", "magnet Ä")
        signals = [
            {"values": current[:, None], "label": "I_A", "blockName": "m/S"},
            {"values": force[:, None], "label": "F_N", "blockName": "m/S"},
        ]
        put(file, "scope", {"time": times[:, None], "signals": signals})
    with path.open("r+b") as stream:
        text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 01 10:00:00 2024 HDF5"
        stream.write(text.ljust(116) + bytes(8) + b"\x00\x02IM")
    return path


def object_in_v5(path: Path) -> Path:
    """Write a MAT file of version 5 that contains only a timeseries object."""

    def part(kind: int, content: bytes) -> bytes:
        return struct.pack("<2I", kind, len(content)) + content + bytes(-len(content) % 8)

    inner = part(6, struct.pack("<2I", 13, 0)) + part(5, struct.pack("<2i", 1, 1))
    inner += part(1, b"") + part(6, struct.pack("<I", 0xDD000000))
    texts = b"".join(part(1, text) for text in (b"logs", b"MCOS", b"timeseries"))
    body = part(6, struct.pack("<2I", 17, 0)) + texts + part(14, inner)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(head + part(14, body))
    return path


def workbook(
    path: Path, *sheets: Sequence[Sequence[Any]], cells: str = "", names: Sequence[str] = ()
) -> Path:
    """Write a workbook; texts are shared, ``cells`` is XML added to the first sheet."""
    texts: dict[str, int] = {}

    def cell(row: int, column: int, value: Any) -> str:
        place = f"{chr(65 + column)}{row}"
        if value is None:
            return ""
        if isinstance(value, str):
            number = texts.setdefault(value, len(texts))
            return f'<c r="{place}" t="s"><v>{number}</v></c>'
        return f'<c r="{place}"><v>{value!r}</v></c>'

    pages = []
    for sheet in sheets:
        rows = [
            f'<row r="{n}">' + "".join(cell(n, c, v) for c, v in enumerate(row)) + "</row>"
            for n, row in enumerate(sheet, start=1)
        ]
        pages.append("".join(rows))
    pages[0] += cells
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    numbers = range(1, len(pages) + 1)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{package}/content-types"><Default Extension="xml" '
            'ContentType="application/xml"/></Types>',
        )
        archive.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
            f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        )
        titles = names or [f"S{n}" for n in numbers]
        listed = "".join(
            f'<sheet name="{title}" sheetId="{n}" r:id="r{n}"/>'
            for n, title in zip(numbers, titles, strict=True)
        )
        archive.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets>{listed}</sheets></workbook>',
        )
        links = "".join(
            f'<Relationship Id="r{n}" Type="{office}/worksheet" Target="worksheets/s{n}.xml"/>'
            for n in numbers
        )
        archive.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{package}/relationships">{links}<Relationship Id="rs" '
            f'Type="{office}/sharedStrings" Target="sharedStrings.xml"/></Relationships>',
        )
        for number, page in zip(numbers, pages, strict=True):
            archive.writestr(
                f"xl/worksheets/s{number}.xml",
                f'<worksheet xmlns="{main}"><sheetData>{page}</sheetData></worksheet>',
            )
        shared = "".join(f"<si><t>{text}</t></si>" for text in texts)
        archive.writestr("xl/sharedStrings.xml", f'<sst xmlns="{main}">{shared}</sst>')
    return path
