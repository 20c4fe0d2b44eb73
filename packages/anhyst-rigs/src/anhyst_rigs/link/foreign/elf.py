"""Read the global variables of a firmware from the debug information of its ELF file (DWARF 2 to 5)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from anhyst.support.errors import InputError
from anhyst_rigs.link.foreign.variables import (
    MAX_ADDRESS,
    MAX_ARRAY_ELEMENTS,
    BitField,
    Description,
    OmittedError,
    SlaveVariable,
    names_text,
    require_variables,
)

MAX_MEMBERS = 200_000
"""Maximum number of scalars in one variable."""
_OP_ADDRESS, _OP_PLUS = 0x03, 0x23
_FLOAT, _BOOLEAN = 0x04, 0x02
_SIGNED_ENCODINGS = {0x05, 0x06, 0x0D}
_UNSIGNED_ENCODINGS = {_BOOLEAN, 0x07, 0x08, 0x10}
_QUALIFIERS = {f"DW_TAG_{name}_type" for name in ("const", "volatile", "restrict", "atomic", "packed")} | {
    "DW_TAG_typedef"
}
_WRITE_FLAG, _ALLOCATE_FLAG = 0x1, 0x2


class _Member(NamedTuple):
    """A scalar within a variable."""

    suffix: str  # ``.b[3].c``
    offset: int  # bytes
    dtype: str
    bits: BitField | None
    doc: str


def read_elf(path: Path) -> Description:
    """Return the global variables of an ELF file; variables of unsupported types are counted."""
    try:
        from elftools.elf.elffile import ELFFile
    except ImportError:
        text = "live: pyelftools is not installed: pip install 'anhyst[verify]'"
        raise InputError(text, code="not-installed", key="pyelftools") from None
    try:
        with path.open("rb") as stream:
            elf = ELFFile(stream)
            if elf.header.e_type == "ET_REL":
                raise InputError(
                    f"{path}: is an object file without addresses; choose the linked program", code="no-data"
                )
            if not elf.has_dwarf_info(strict=True):
                raise InputError(
                    f"{path}: has no debug information (DWARF); compile it with -g, and do not strip it",
                    code="no-data",
                )
            return require_variables(_ElfReader(path.name, elf).read())
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}", code="cannot-be-read") from None
    except Exception as error:
        reason = str(error).splitlines()[0][:100] if str(error) else type(error).__name__
        raise InputError(
            f"{path}: is damaged or incomplete ({reason}); build it again", code="damaged-file"
        ) from None


@dataclass
class _ElfReader:
    """An open ELF file with its debug information."""

    source: str
    elf: Any

    def __post_init__(self) -> None:
        self._order = "<" if self.elf.little_endian else ">"
        self._members: dict[int, list[_Member]] = {}

    def read(self) -> Description:
        """Return all variables; equal names in several source files get the name of their file."""
        description = Description(
            self.source, is_big_endian=not self.elf.little_endian, lists_parameters=False
        )
        found: defaultdict[str, dict[int, tuple[str, Any]]] = defaultdict(dict)
        for unit in self.elf.get_dwarf_info().iter_CUs():
            top = unit.get_top_DIE()
            for name, address, die in self._iterate_variables(top, ""):
                found[name][address] = (PurePosixPath(_text(top, "DW_AT_name")).name, die)
        for name, places in found.items():
            for address, (file_name, die) in places.items():
                full_name = name if len(places) == 1 else f"{file_name}:{name}"
                try:
                    for variable in self._expand(full_name, address, die):
                        description.variables[variable.name] = variable
                except OmittedError as reason:
                    description.omitted[str(reason)] += 1
        return description

    def _iterate_variables(self, parent: Any, scope: str) -> Iterator[tuple[str, int, Any]]:
        """Yield the name, address and entry of each global variable."""
        for die in parent.iter_children():
            if die.tag == "DW_TAG_namespace":
                yield from self._iterate_variables(
                    die, f"{scope}{_text(die, 'DW_AT_name') or '(anonymous)'}::"
                )
            if die.tag != "DW_TAG_variable" or "DW_AT_location" not in die.attributes:
                continue
            address = self._address(die.attributes["DW_AT_location"])
            declared = die
            if "DW_AT_specification" in die.attributes:
                declared = die.get_DIE_from_attribute("DW_AT_specification")
            name = _text(declared, "DW_AT_name")
            if address is not None and name:
                yield f"{scope}{name}", address, declared

    def _address(self, location: Any) -> int | None:
        """Return the constant address of a location, or None if the variable has no fixed address."""
        if not isinstance(location.value, list) or not location.value or location.value[0] != _OP_ADDRESS:
            return None
        size = self.elf.elfclass // 8
        data = bytes(location.value[1 : 1 + size])
        if len(location.value) != 1 + size:
            return None
        return int.from_bytes(data, "little" if self.elf.little_endian else "big")

    def _expand(self, name: str, address: int, die: Any) -> Iterator[SlaveVariable]:
        """Yield the scalars of a variable."""
        if "DW_AT_type" not in die.attributes:
            raise OmittedError("no type")
        whole_type = die.get_DIE_from_attribute("DW_AT_type")
        is_writable = self._is_in_writable_section(address) and not _is_constant(whole_type)
        for member in self._type_members(whole_type):
            if address + member.offset > MAX_ADDRESS:
                raise OmittedError("an address of more than 32 bits")
            yield SlaveVariable(
                f"{name}{member.suffix}",
                address + member.offset,
                member.dtype,
                doc=member.doc,
                bits=member.bits,
                is_writable=is_writable,
            )

    @cached_property
    def _writable_ranges(self) -> list[tuple[int, int]]:
        return [
            (section["sh_addr"], section["sh_addr"] + section["sh_size"])
            for section in self.elf.iter_sections()
            if section["sh_flags"] & _WRITE_FLAG and section["sh_flags"] & _ALLOCATE_FLAG
        ]

    def _is_in_writable_section(self, address: int) -> bool:
        return any(begin <= address < end for begin, end in self._writable_ranges)

    def _type_members(self, die: Any) -> list[_Member]:
        """Return the scalars of a type; the list is kept for other variables of this type."""
        if die.offset not in self._members:
            self._members[die.offset] = self._make_members(die)
        return self._members[die.offset]

    def _make_members(self, die: Any) -> list[_Member]:
        if die.tag in _QUALIFIERS and "DW_AT_type" in die.attributes:
            return self._type_members(die.get_DIE_from_attribute("DW_AT_type"))
        if die.tag == "DW_TAG_base_type":
            return [self._base_member(die)]
        if die.tag == "DW_TAG_enumeration_type":
            return [self._enum_member(die)]
        if die.tag == "DW_TAG_array_type":
            return self._array_members(die)
        if die.tag in {"DW_TAG_structure_type", "DW_TAG_class_type", "DW_TAG_union_type"}:
            return self._struct_members(die)
        raise OmittedError(f"the type {die.tag.removeprefix('DW_TAG_').removesuffix('_type')}")

    def _base_member(self, die: Any) -> _Member:
        size, encoding = _number(die, "DW_AT_byte_size"), _number(die, "DW_AT_encoding")
        order = {1: ">", 2: "<"}.get(_number(die, "DW_AT_endianity"), self._order)
        if encoding == _FLOAT and size in {2, 4, 8}:
            return _Member("", 0, f"{order}f{size}", None, "")
        if size not in {1, 2, 4, 8} or encoding not in _SIGNED_ENCODINGS | _UNSIGNED_ENCODINGS:
            raise OmittedError(f"the type {_text(die, 'DW_AT_name')} of {size} bytes")
        letter = "i" if encoding in _SIGNED_ENCODINGS else "u"
        return _Member("", 0, f"{order}{letter}{size}", None, "")

    def _enum_member(self, die: Any) -> _Member:
        names = {
            _number(one, "DW_AT_const_value"): _text(one, "DW_AT_name")
            for one in die.iter_children()
            if one.tag == "DW_TAG_enumerator"
        }
        size = _number(die, "DW_AT_byte_size") or 4
        is_signed = min(names, default=0) < 0
        return _Member("", 0, f"{self._order}{'i' if is_signed else 'u'}{size}", None, names_text(names))

    def _array_members(self, die: Any) -> list[_Member]:
        elements = self._type_members(die.get_DIE_from_attribute("DW_AT_type"))
        element_size = _type_size(die.get_DIE_from_attribute("DW_AT_type"))
        indices = [""]
        for bound in die.iter_children():
            if bound.tag != "DW_TAG_subrange_type":
                continue
            count = _number(bound, "DW_AT_count")
            if "DW_AT_upper_bound" in bound.attributes:
                count = _number(bound, "DW_AT_upper_bound") + 1
            if count * len(indices) > MAX_ARRAY_ELEMENTS:
                raise OmittedError(f"more than {MAX_ARRAY_ELEMENTS} elements")
            indices = [f"{index}[{n}]" for index in indices for n in range(count)]
        if len(indices) * len(elements) > MAX_MEMBERS:
            raise OmittedError(f"more than {MAX_MEMBERS} members")
        return [
            element._replace(suffix=f"{index}{element.suffix}", offset=n * element_size + element.offset)
            for n, index in enumerate(indices)
            for element in elements
        ]

    def _struct_members(self, die: Any) -> list[_Member]:
        """Return the members of a structure; members of unsupported types are omitted."""
        members: list[_Member] = []
        for field in die.iter_children():
            if (
                field.tag not in {"DW_TAG_member", "DW_TAG_inheritance"}
                or "DW_AT_type" not in field.attributes
            ):
                continue
            if "DW_AT_external" in field.attributes:
                continue  # a static member, which is a variable of its own
            name = _text(field, "DW_AT_name") if field.tag == "DW_TAG_member" else ""
            offset = self._member_offset(field)
            try:
                inner = self._type_members(field.get_DIE_from_attribute("DW_AT_type"))
            except OmittedError:
                continue
            if _number(field, "DW_AT_bit_size"):
                members.append(self._bit_member(field, name, offset, inner[0]))
                continue
            prefix = f".{name}" if name else ""
            members += [
                one._replace(suffix=f"{prefix}{one.suffix}", offset=offset + one.offset) for one in inner
            ]
        if not members:
            raise OmittedError("only members of unsupported types")
        return members

    def _member_offset(self, field: Any) -> int:
        location = field.attributes.get("DW_AT_data_member_location")
        if location is None:
            return 0
        if isinstance(location.value, int):
            return location.value
        if location.value and location.value[0] == _OP_PLUS:
            return _uleb128(location.value[1:])
        raise OmittedError("a member at a computed address")

    def _bit_member(self, field: Any, name: str, offset: int, whole: _Member) -> _Member:
        """Return a bit field as some bits of the integer that contains it."""
        size = _number(field, "DW_AT_bit_size")
        is_signed = whole.dtype[1] == "i"
        if "DW_AT_bit_offset" in field.attributes:  # DWARF 2 and 3: counted from the most significant bit
            bytes_ = _number(field, "DW_AT_byte_size") or int(whole.dtype[2:])
            shift = 8 * bytes_ - _number(field, "DW_AT_bit_offset") - size
        else:
            first_bit = _number(field, "DW_AT_data_bit_offset") + 8 * offset
            offset, bit = divmod(first_bit, 8)
            bytes_ = next((count for count in (1, 2, 4, 8) if bit + size <= 8 * count), 0)
            shift = bit if self._order == "<" else 8 * bytes_ - bit - size
        if not bytes_ or shift < 0:
            return whole._replace(suffix=f".{name}", offset=offset)
        bits = BitField(shift, size, is_signed)
        return whole._replace(suffix=f".{name}", offset=offset, dtype=f"{self._order}u{bytes_}", bits=bits)


def _is_constant(die: Any) -> bool:
    """Whether a type is constant and not volatile, so that the program may not read it from memory."""
    tags = set()
    while die.tag in _QUALIFIERS | {"DW_TAG_array_type"} and "DW_AT_type" in die.attributes:
        tags.add(die.tag)
        die = die.get_DIE_from_attribute("DW_AT_type")
    return "DW_TAG_const_type" in tags and "DW_TAG_volatile_type" not in tags


def _type_size(die: Any) -> int:
    """Return the size of a type, bytes."""
    while die.tag in _QUALIFIERS:
        die = die.get_DIE_from_attribute("DW_AT_type")
    if die.tag == "DW_TAG_array_type" and "DW_AT_byte_size" not in die.attributes:
        count = 1
        for bound in die.iter_children():
            if bound.tag == "DW_TAG_subrange_type":
                is_bound = "DW_AT_upper_bound" in bound.attributes
                count *= (
                    _number(bound, "DW_AT_upper_bound") + 1 if is_bound else _number(bound, "DW_AT_count")
                )
        return count * _type_size(die.get_DIE_from_attribute("DW_AT_type"))
    return _number(die, "DW_AT_byte_size")


def _text(die: Any, attribute: str) -> str:
    value = die.attributes.get(attribute)
    return (
        value.value.decode("utf-8", "replace") if value is not None and isinstance(value.value, bytes) else ""
    )


def _number(die: Any, attribute: str) -> int:
    value = die.attributes.get(attribute)
    return value.value if value is not None and isinstance(value.value, int) else 0


def _uleb128(data: list[int]) -> int:
    value = 0
    for index, byte in enumerate(data):
        value |= (byte & 0x7F) << 7 * index
        if not byte & 0x80:
            break
    return value
