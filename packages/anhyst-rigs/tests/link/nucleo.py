"""Emulate the parts of an STM32F446 that the firmware of the Nucleo uses, around a Cortex-M4."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest

FLASH, RAM, DEVICES, CORE = 0x08000000, 0x20000000, 0x40000000, 0xE0000000
PAGE = 0x100000
RCC_CR, RCC_CFGR = 0x40023800, 0x40023808
TIM5_CNT = 0x40000C24
ADC_JDR1 = tuple(0x4001203C + 0x100 * n for n in range(3))
DAC_DHR12R1 = 0x40007408
GPIOB_IDR = 0x40020410
STOP_CLOSED, AMPLIFIER_READY, CURRENT_FINE = 1 << 4, 1 << 5, 1 << 12
TIM1_SR, TIM1_CCMR1, TIM1_CCR2, TIM1_BDTR = 0x40010010, 0x40010018, 0x40010038, 0x40010044
BROKEN, STAGE_ON, OUTPUTS_ON = 1 << 7, 5 << 4, 1 << 15
TIM4_CNT = 0x40000824
SPI2_SR, SPI2_DR = 0x40003808, 0x4000380C
DWT_CYCCNT = 0xE0001004
FLASH_KEYR, FLASH_SR, FLASH_CR = 0x40023C04, 0x40023C0C, 0x40023C10
KEYS = [0x45670123, 0xCDEF89AB]
FLASH_PROGRAM, SER, PSIZE_32, STRT, LOCK = 1 << 0, 1 << 1, 2 << 8, 1 << 16, 1 << 31
SECTORS = {6: FLASH + 0x40000, 7: FLASH + 0x60000}
SECTOR_BYTES = 0x20000
FEED = 0x40003000
RING = 2048
HANDLER_RETURN = FLASH + 0xFFFF0
ADC_IRQ = 18


class Serial(NamedTuple):
    """A serial port with the DMA stream that receives from it."""

    port: int
    stream: int
    irq: int


LINK, XCP = Serial(0x40004400, 0x40026088, 38), Serial(0x40004C00, 0x40026040, 52)
SR, DR, BRR, CR1 = 0x00, 0x04, 0x08, 0x0C
NDTR, MEMORY = 0x04, 0x0C
SENDS = 1 << 7


class Chip:
    """The processor with its devices: registers that store written values; a few also respond.

    Attributes
    ----------
    written : dict of int to int
        Last value written to each register.
    sent : dict of Serial to bytearray
        Bytes sent by each serial port.
    codes : list of int
        Codes of the three converters: gap, force, current.
    inputs : int
        Levels of the pins of port B.
    edges : int
        Counter of the encoder.
    place : int or None
        Code of the 16-bit position converter; None if it does not respond.
    power : int or None
        Words and erasures of the flash that succeed before the power fails; None for no failure.
    dead : bool
        Whether the power has failed.
    """

    def __init__(self, program: Path, flash: bytes | None = None) -> None:
        unicorn = pytest.importorskip("unicorn", reason="unicorn: pip install 'anhyst[verify]'")
        from elftools.elf.elffile import ELFFile

        self.written: dict[int, int] = {}
        self.sent = {LINK: bytearray(), XCP: bytearray()}
        self.codes = [2048, 410, 410]
        self.inputs = STOP_CLOSED | AMPLIFIER_READY | CURRENT_FINE
        self.edges = 0
        self.place: int | None = None
        self.power: int | None = None
        self.dead = False
        self._keys: list[int] = []
        self._cycles = 0
        self._u = unicorn
        self._received = {LINK: 0, XCP: 0}
        self._tick = 0
        cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        cpu.ctl_set_cpu_model(unicorn.arm_const.UC_CPU_ARM_CORTEX_M4)
        for base in (FLASH, RAM, DEVICES, CORE):
            cpu.mem_map(base, PAGE)
        with program.open("rb") as stream:
            for segment in ELFFile(stream).iter_segments("PT_LOAD"):
                cpu.mem_write(segment["p_paddr"], segment.data())
        cpu.mem_write(SECTORS[6], flash or b"\xff" * 2 * SECTOR_BYTES)
        cpu.hook_add(unicorn.UC_HOOK_MEM_WRITE, self._program, begin=FLASH, end=FLASH + PAGE)
        kind = unicorn.UC_HOOK_MEM_READ | unicorn.UC_HOOK_MEM_WRITE
        cpu.hook_add(kind, self._device, begin=DEVICES, end=CORE + PAGE)
        self._cpu = cpu
        self._put(RCC_CR, 1 << 17 | 1 << 25)
        for line in (LINK, XCP):
            self._put(line.port + SR, 1 << 7)
            self._put(line.stream + NDTR, RING)

    def start(self) -> None:
        """Run from reset to the main loop."""
        stack, reset = (self._word(FLASH), self._word(FLASH + 4))
        self._cpu.reg_write(self._u.arm_const.UC_ARM_REG_SP, stack)
        self._run(reset, instructions=600_000)

    def main_loop(self) -> None:
        """Run the main loop for a while."""
        self._run(self._cpu.reg_read(self._u.arm_const.UC_ARM_REG_PC) | 1, instructions=20_000)

    def interrupt(self, number: int) -> None:
        """Run an interrupt handler to its end, on the stack of the interrupted code."""
        context = self._cpu.context_save()
        self._cpu.reg_write(self._u.arm_const.UC_ARM_REG_LR, HANDLER_RETURN | 1)
        self._cpu.emu_start(self._word(FLASH + 4 * (16 + number)), HANDLER_RETURN)
        self._cpu.context_restore(context)

    def tick(self) -> None:
        """Convert the signals, and compute a tick."""
        self._tick += 1
        self._put(TIM5_CNT, self._tick)
        for register, code in zip(ADC_JDR1, self.codes, strict=True):
            self._put(register, code)
        self._put(GPIOB_IDR, self.inputs)
        self._put(TIM4_CNT, self.edges & 0xFFFF)
        self._put(SPI2_SR, int(self.place is not None))
        self._put(SPI2_DR, self.place or 0)
        if not self.inputs & CURRENT_FINE:  # effect of the timer hardware
            self._put(TIM1_SR, BROKEN)
            self.written[TIM1_BDTR] = self.written.get(TIM1_BDTR, 0) & ~OUTPUTS_ON
        self.interrupt(ADC_IRQ)

    def flash(self) -> bytes:
        """Return the two non-volatile sectors."""
        return bytes(self._cpu.mem_read(SECTORS[6], 2 * SECTOR_BYTES))

    def receive(self, data: bytes, line: Serial = LINK) -> None:
        """Receive bytes by DMA, and run the main loop."""
        memory = self.written[line.stream + MEMORY]
        for byte in data:
            self._cpu.mem_write(memory + self._received[line] % RING, bytes([byte]))
            self._received[line] += 1
        self._put(line.stream + NDTR, RING - self._received[line] % RING)
        self.main_loop()

    def send(self, line: Serial = LINK) -> bytes:
        """Run the interrupt of a serial port until it has nothing to send; returns the sent bytes."""
        self.sent[line].clear()
        while self.written[line.port + CR1] & SENDS:
            self.interrupt(line.irq)
        return bytes(self.sent[line])

    def _run(self, address: int, instructions: int) -> None:
        self._cpu.emu_start(address, 0, count=instructions)

    def _word(self, address: int) -> int:
        return int.from_bytes(self._cpu.mem_read(address, 4), "little")

    def _put(self, register: int, value: int) -> None:
        self._cpu.mem_write(register, value.to_bytes(4, "little"))

    def _device(self, _cpu: object, access: int, address: int, _size: int, value: int, _: object) -> None:
        if access == self._u.UC_MEM_WRITE:
            self.written[address] = value
            for line, sent in self.sent.items():
                if address == line.port + DR:
                    sent.append(value & 0xFF)
            if address == FLASH_KEYR:
                self._keys.append(value)
            elif address == FLASH_CR:
                self._command(value)
        elif address == FLASH_SR:
            self._put(FLASH_SR, 0)  # completed immediately, without an error
        elif address == DWT_CYCCNT:
            self._cycles += 1000
            self._put(DWT_CYCCNT, self._cycles)
        elif address == RCC_CFGR:
            clock = self.written.get(address, 0)
            self._put(address, clock | (clock & 3) << 2)  # the clock is switched

    def _command(self, command: int) -> None:
        """Execute a write to the control register of the flash."""
        if command & LOCK:
            self._keys.clear()
            return
        assert self._keys[-2:] == KEYS, "the flash is locked"
        if command & STRT:
            assert command & (SER | PSIZE_32) == SER | PSIZE_32
            assert self._cpu.reg_read(self._u.arm_const.UC_ARM_REG_PC) >= RAM, "runs from flash"
            if self._has_power():
                self._cpu.mem_write(SECTORS[command >> 3 & 0xF], b"\xff" * SECTOR_BYTES)

    def _has_power(self) -> bool:
        if self.power is None:
            return True
        if self.power == 0:
            self.dead = True
            self._cpu.emu_stop()
            return False
        self.power -= 1
        return True

    def _program(self, _cpu: object, _access: int, address: int, size: int, value: int, _: object) -> None:
        """Clear bits of a word; allowed only if the flash is unlocked for a word."""
        assert self._keys[-2:] == KEYS
        assert self.written[FLASH_CR] == FLASH_PROGRAM | PSIZE_32
        assert (size, self._word(address)) == (4, 0xFFFFFFFF)
        assert min(SECTORS.values()) <= address < max(SECTORS.values()) + SECTOR_BYTES
        self._has_power()
