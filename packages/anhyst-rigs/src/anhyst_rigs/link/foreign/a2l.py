"""Read the variables and events of a firmware from its A2L file (ASAM MCD-2 MC 1.5 to 1.7)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from anhyst.support.errors import InputError
from anhyst_rigs.link.foreign.a2l_text import A2lBlock, read_blocks
from anhyst_rigs.link.foreign.variables import (
    IDENTICAL,
    MAX_ADDRESS,
    MAX_ARRAY_ELEMENTS,
    BitField,
    ConversionTable,
    Description,
    EventChannel,
    Linear,
    OmittedError,
    Rational,
    RawConversion,
    SerialLine,
    SlaveVariable,
    names_text,
    require_variables,
)

_TYPES = {
    **{"UBYTE": "u1", "SBYTE": "i1", "UWORD": "u2", "SWORD": "i2", "ULONG": "u4", "SLONG": "i4"},
    **{"A_UINT64": "u8", "A_INT64": "i8"},
    **{"FLOAT16_IEEE": "f2", "FLOAT32_IEEE": "f4", "FLOAT64_IEEE": "f8"},
}
_BYTE_ORDERS = {"MSB_LAST": "<", "MSB_FIRST": ">"}
_HEADS = {
    **{"HEADER_LEN_BYTE": "<B", "HEADER_LEN_CTR_BYTE": "<BB", "HEADER_LEN_FILL_BYTE": "<Bx"},
    **{"HEADER_LEN_WORD": "<H", "HEADER_LEN_CTR_WORD": "<HH", "HEADER_LEN_FILL_WORD": "<Hxx"},
}
_CHECKSUM_BYTES = {"NO_CHECKSUM": 0, "CHECKSUM_BYTE": 1, "CHECKSUM_WORD": 2}
_UNIT_EXPONENTS = (-9, -8, -7, -6, -5, -4, -3, -2, -1, 0, -12, -11, -10)
"""Powers of ten of the time units 0 to 12 of XCP, s."""


_OWN_MARK = "contract/xcp.toml"
"""Text in the MOD_PAR of the files that anhyst writes."""


def read_a2l(path: Path) -> Description:
    """Return the variables of an A2L file; quantities of unsupported kinds are counted."""
    root = read_blocks(path)
    modules = [module for project in root.inner("PROJECT") for module in project.inner("MODULE")]
    if not modules:
        raise InputError(
            f"{path}: is not an A2L file, it contains no PROJECT with a MODULE", code="damaged-file"
        )
    description = Description(path.name)
    for module in modules:
        _ModuleReader(path, module).read_into(description)
    interfaces = [
        block
        for module in modules
        for block in module.inner("IF_DATA")
        if block.items and block.items[0].startswith("XCP")
    ]
    description.events = tuple(
        _read_event(path, block) for one in interfaces for block in one.nested("EVENT")
    )
    lines = [block for one in interfaces for block in one.nested("XCP_ON_SxI")]
    description.serial = _read_serial_line(path, lines[0]) if lines else None
    return require_variables(description)


class _ModuleReader:
    """The definitions of a MODULE that its quantities refer to."""

    def __init__(self, path: Path, module: A2lBlock) -> None:
        self._path, self._module = path, module
        self._methods = self._by_name("COMPU_METHOD")
        self._tables = self._by_name("COMPU_TAB", "COMPU_VTAB", "COMPU_VTAB_RANGE")
        self._layouts = self._by_name("RECORD_LAYOUT")
        common = next(module.inner("MOD_COMMON"), A2lBlock("MOD_COMMON", 0))
        self._byte_order = (common.option("BYTE_ORDER") or ["MSB_LAST"])[0]

    def _by_name(self, *keywords: str) -> Mapping[str, A2lBlock]:
        return {block.items[0]: block for block in self._module.inner(*keywords) if block.items}

    def read_into(self, description: Description) -> None:
        """Add the variables of the module to a description."""
        description.is_big_endian = self._byte_order == "MSB_FIRST"
        parameters = next(self._module.inner("MOD_PAR"), A2lBlock("MOD_PAR", 0))
        description.has_known_key |= any(_OWN_MARK in item for item in parameters.items[:1])
        for block in self._module.inner("MEASUREMENT", "CHARACTERISTIC", "INSTANCE"):
            read = {"MEASUREMENT": self._read_measurement, "CHARACTERISTIC": self._read_characteristic}
            try:
                if block.keyword == "INSTANCE":
                    raise OmittedError("a TYPEDEF of A2L 1.7")
                for variable in read[block.keyword](block):
                    description.variables[variable.name] = variable
                    if block.keyword == "MEASUREMENT":
                        description.measurements.append(variable.name)
            except OmittedError as reason:
                description.omitted[str(reason)] += 1
            except (ValueError, IndexError):
                name = block.items[0] if block.items else "?"
                raise _bad_block(self._path, block, f"{block.keyword} {name}") from None

    def _read_measurement(self, block: A2lBlock) -> Iterator[SlaveVariable]:
        name, doc, data_type, method, _, _, low, high = block.items[:8]
        address = block.option("ECU_ADDRESS")
        if not address or block.option("VIRTUAL") or any(block.inner("VIRTUAL")):
            raise OmittedError("no address")
        dimensions = block.option("MATRIX_DIM", 5) or block.option("ARRAY_SIZE")
        is_writable = "READ_WRITE" in block.items[8:]
        template = self._make(
            block, (name, doc, data_type, method, low, high), _integer(address[0]), is_writable
        )
        return expand_array(template, _element_count(dimensions))

    def _read_characteristic(self, block: A2lBlock) -> Iterator[SlaveVariable]:
        name, doc, kind, address, layout, _, method, low, high = block.items[:9]
        if kind not in {"VALUE", "VAL_BLK"}:
            raise OmittedError(f"type {kind}")
        if any(block.inner("VIRTUAL_CHARACTERISTIC", "DEPENDENT_CHARACTERISTIC")):
            raise OmittedError("a value that depends on others")
        access = block.option("CALIBRATION_ACCESS")
        is_writable = "READ_ONLY" not in block.items[9:] and access in ([], ["CALIBRATION"])
        data_type = self._read_layout(layout)
        template = self._make(
            block, (name, doc, data_type, method, low, high), _integer(address), is_writable
        )
        dimensions = block.option("MATRIX_DIM", 5) or block.option("NUMBER")
        return expand_array(template, _element_count(dimensions) if kind == "VAL_BLK" else 0)

    def _read_layout(self, name: str) -> str:
        """Return the data type of a record layout that contains only values."""
        layout = self._layouts.get(name)
        values = [] if layout is None else layout.option("FNC_VALUES", 4)
        if layout is None or len(layout.items) != 6 or len(values) != 4 or values[3] != "DIRECT":
            raise OmittedError("a record layout that contains more than values")
        return values[1]

    def _make(
        self, block: A2lBlock, fields: tuple[str, str, str, str, str, str], address: int, is_writable: bool
    ) -> SlaveVariable:
        """Return a variable, or the first element of an array."""
        name, doc, data_type, method, low_text, high_text = fields
        byte_order = (block.option("BYTE_ORDER") or [self._byte_order])[0]
        if byte_order not in _BYTE_ORDERS:
            raise OmittedError(f"byte order {byte_order} (write MSB_FIRST or MSB_LAST)")
        if data_type not in _TYPES:
            raise OmittedError(f"data type {data_type}")
        if list(block.inner("BIT_OPERATION")):
            raise OmittedError("a BIT_OPERATION")
        if not 0 <= address <= MAX_ADDRESS:
            raise OmittedError("an address of more than 32 bits")
        low, high = float(low_text), float(high_text)
        if low >= high:
            low, high = -math.inf, math.inf
        conversion, unit, names = self._read_conversion(method, low, high)
        is_invertible = not isinstance(conversion, ConversionTable) or conversion.is_unambiguous()
        mask, extension = block.option("BIT_MASK"), block.option("ECU_ADDRESS_EXTENSION")
        return SlaveVariable(
            name=name,
            address=address,
            dtype=_BYTE_ORDERS[byte_order] + _TYPES[data_type],
            unit=(block.option("PHYS_UNIT") or [unit])[0],
            doc="; ".join(filter(None, (doc, names))),
            low=low,
            high=high,
            extension=_integer(extension[0]) & 0xFF if extension else 0,
            conversion=conversion,
            bits=_bit_field(_integer(mask[0]), _TYPES[data_type]) if mask else None,
            is_writable=is_writable and is_invertible,
            events=_read_variable_events(block),
        )

    def _read_conversion(self, name: str, low: float, high: float) -> tuple[RawConversion, str, str]:
        """Return a conversion, its unit, and the names of its raw numbers."""
        if name == "NO_COMPU_METHOD":
            return IDENTICAL, "", ""
        method = self._methods.get(name)
        if method is None:
            raise OmittedError(f"an undefined conversion {name}")
        kind, unit = method.items[2], method.items[4]
        if kind == "IDENTICAL":
            return IDENTICAL, unit, ""
        if kind == "LINEAR":
            factor, offset = map(float, method.option("COEFFS_LINEAR", 2))
            if factor == 0.0:
                raise OmittedError("a conversion with the factor 0")
            return Linear(factor, offset), unit, ""
        if kind == "RAT_FUNC":
            return _rational([float(item) for item in method.option("COEFFS", 6)], low, high), unit, ""
        if kind in {"TAB_VERB", "TAB_INTP", "TAB_NOINTP"}:
            return self._read_table(method, kind, unit)
        raise OmittedError(f"conversion {kind}")

    def _read_table(self, method: A2lBlock, kind: str, unit: str) -> tuple[RawConversion, str, str]:
        table = self._tables.get((method.option("COMPU_TAB_REF") or [""])[0])
        if table is None:
            raise OmittedError("an undefined conversion table")
        if table.keyword == "COMPU_VTAB_RANGE":
            count = int(table.items[2])
            rows = [table.items[3 + 3 * n : 6 + 3 * n] for n in range(count)]
            texts = [
                f"{low} {text}" if low == high else f"{low} to {high} {text}" for low, high, text in rows
            ]
            return IDENTICAL, "", ", ".join(texts)
        pairs = [table.items[4 + 2 * n : 6 + 2 * n] for n in range(int(table.items[3]))]
        if table.keyword == "COMPU_VTAB":
            return IDENTICAL, "", names_text((_integer(number), text) for number, text in pairs)
        numbers = sorted((float(raw), float(value)) for raw, value in pairs)
        default = table.option("DEFAULT_VALUE_NUMERIC")
        raw, physical = zip(*numbers, strict=True)
        return (
            ConversionTable(raw, physical, kind == "TAB_INTP", float(default[0]) if default else math.nan),
            unit,
            "",
        )


def expand_array(element: SlaveVariable, count: int) -> Iterator[SlaveVariable]:
    """Yield the elements of an array in the order of memory; a scalar has the count 0."""
    if count > MAX_ARRAY_ELEMENTS:
        raise OmittedError(f"more than {MAX_ARRAY_ELEMENTS} elements")
    if element.address + count * element.size > MAX_ADDRESS + 1:
        raise OmittedError("an address of more than 32 bits")
    if not count:
        yield element
    for index in range(count):
        yield replace(
            element, name=f"{element.name}[{index}]", address=element.address + index * element.size
        )


def _rational(coefficients: Sequence[float], low: float, high: float) -> RawConversion:
    """Return a rational conversion, as a linear one if it is linear."""
    a, b, c, d, e, f = coefficients
    if a == d == e == 0.0 and b != 0.0:
        return Linear(f / b, -c / b) if f else _raise_omitted()
    rational = Rational(a, b, c, d, e, f, low, high)
    if not (a == d == 0.0 or math.isfinite(low + high)) or not rational.is_unambiguous():
        return _raise_omitted()
    return rational


def _raise_omitted() -> RawConversion:
    raise OmittedError("a RAT_FUNC that is not monotonic within its limits")


def _bit_field(mask: int, data_type: str) -> BitField | None:
    """Return the bits of a mask, or None if the mask selects the whole integer."""
    size = 8 * int(data_type[1:])
    mask &= (1 << size) - 1
    if mask == (1 << size) - 1:
        return None
    shift = (mask & -mask).bit_length() - 1
    width = mask.bit_count()
    if data_type[0] == "f" or not mask or mask >> shift != (1 << width) - 1:
        raise OmittedError("a bit mask with gaps")
    return BitField(shift, width)


def _element_count(dimensions: Sequence[str]) -> int:
    sizes = []
    for item in dimensions:
        if not item.isdigit():
            break
        sizes.append(int(item))
    count = math.prod(sizes) if sizes else 0
    return 0 if count == 1 else count


def _read_variable_events(block: A2lBlock) -> tuple[int, ...]:
    """Return the numbers of the events that may sample a quantity; empty if the file lists none."""
    numbers: list[int] = []
    for interface in block.inner("IF_DATA"):
        for daq_event in interface.nested("DAQ_EVENT"):
            lists = list(daq_event.inner("AVAILABLE_EVENT_LIST")) or [daq_event]
            for event_list in lists:
                items = event_list.items
                numbers += [_integer(items[n + 1]) for n, item in enumerate(items[:-1]) if item == "EVENT"]
    return tuple(numbers)


def _read_event(path: Path, block: A2lBlock) -> EventChannel:
    try:
        name, _, number, _, _, cycle, unit = block.items[:7]
        return EventChannel(_integer(number), name, _integer(cycle) * 10.0 ** _UNIT_EXPONENTS[_integer(unit)])
    except (ValueError, IndexError):
        raise _bad_block(path, block, "EVENT") from None


def _read_serial_line(path: Path, block: A2lBlock) -> SerialLine | None:
    """Return the settings of a serial port, or None if its framing is not supported."""
    heads = [_HEADS[item] for item in block.items if item in _HEADS]
    checksums = [_CHECKSUM_BYTES[item] for item in block.items if item in _CHECKSUM_BYTES]
    try:
        return SerialLine(_integer(block.items[1]), heads[0], checksums[0]) if heads and checksums else None
    except (ValueError, IndexError):
        raise _bad_block(path, block, "XCP_ON_SxI") from None


def _bad_block(path: Path, block: A2lBlock, name: str) -> InputError:
    return InputError(
        f"{path}; line {block.line}: {name} has missing or wrong fields; export the file again",
        code="damaged-file",
    )


def _integer(text: str) -> int:
    """Return a decimal or hexadecimal integer."""
    return int(text, 16) if text.lower().startswith(("0x", "-0x")) else int(float(text))
