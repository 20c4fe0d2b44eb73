"""As much of an STM32F446 as the firmware of the Nucleo touches, around an emulated Cortex-M4."""

from __future__ import annotations

from pathlib import Path

import pytest

FLASH, RAM, DEVICES, CORE = 0x08000000, 0x20000000, 0x40000000, 0xE0000000
PAGE = 0x100000
RCC_CR, RCC_CFGR = 0x40023800, 0x40023808
TIM5_CNT = 0x40000C24
USART2_SR, USART2_DR, USART2_CR1 = 0x40004400, 0x40004404, 0x4000440C
DMA_NDTR, DMA_MEMORY = 0x4002608C, 0x40026094
ADC_JDR1 = tuple(0x4001203C + 0x100 * n for n in range(3))
DAC_DHR12R1 = 0x40007408
RING = 2048
HANDLER_RETURN = FLASH + 0xFFFF0
ADC_IRQ, USART2_IRQ = 18, 38


class Chip:
    """The processor with its devices: registers that keep what is written, a few that answer.

    Attributes
    ----------
    written : dict of int to int
        What was last written to each register.
    sent : bytearray
        What left the serial port.
    codes : list of int
        What the three converters show: gap, force, current.
    """

    def __init__(self, program: Path) -> None:
        unicorn = pytest.importorskip("unicorn", reason="unicorn: pip install 'anhyst[verify]'")
        from elftools.elf.elffile import ELFFile

        self.written: dict[int, int] = {}
        self.sent = bytearray()
        self.codes = [2048, 410, 410]
        self._u = unicorn
        self._received = 0
        self._tick = 0
        cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        cpu.ctl_set_cpu_model(unicorn.arm_const.UC_CPU_ARM_CORTEX_M4)
        for base in (FLASH, RAM, DEVICES, CORE):
            cpu.mem_map(base, PAGE)
        with program.open("rb") as stream:
            for segment in ELFFile(stream).iter_segments("PT_LOAD"):
                cpu.mem_write(segment["p_paddr"], segment.data())
        kind = unicorn.UC_HOOK_MEM_READ | unicorn.UC_HOOK_MEM_WRITE
        cpu.hook_add(kind, self._device, begin=DEVICES, end=CORE + PAGE)
        self._cpu = cpu
        self._put(RCC_CR, 1 << 17 | 1 << 25)
        self._put(USART2_SR, 1 << 7)
        self._put(DMA_NDTR, RING)

    def start(self) -> None:
        """Run from reset into the main loop."""
        stack, reset = (self._word(FLASH), self._word(FLASH + 4))
        self._cpu.reg_write(self._u.arm_const.UC_ARM_REG_SP, stack)
        self._run(reset, instructions=600_000)

    def main_loop(self) -> None:
        """Let the main loop turn for a while."""
        self._run(self._cpu.reg_read(self._u.arm_const.UC_ARM_REG_PC) | 1, instructions=20_000)

    def interrupt(self, number: int) -> None:
        """Run a handler to its end, on the stack of what it interrupts."""
        context = self._cpu.context_save()
        self._cpu.reg_write(self._u.arm_const.UC_ARM_REG_LR, HANDLER_RETURN | 1)
        self._cpu.emu_start(self._word(FLASH + 4 * (16 + number)), HANDLER_RETURN)
        self._cpu.context_restore(context)

    def tick(self) -> None:
        """Convert, and compute a tick."""
        self._tick += 1
        self._put(TIM5_CNT, self._tick)
        for register, code in zip(ADC_JDR1, self.codes, strict=True):
            self._put(register, code)
        self.interrupt(ADC_IRQ)

    def receive(self, data: bytes) -> None:
        """Let bytes arrive by DMA, and the main loop look at them."""
        memory = self.written[DMA_MEMORY]
        for byte in data:
            self._cpu.mem_write(memory + self._received % RING, bytes([byte]))
            self._received += 1
        self._put(DMA_NDTR, RING - self._received % RING)
        self.main_loop()

    def send(self) -> bytes:
        """Run the serial port's interrupt until it has nothing to send; return what left."""
        self.sent.clear()
        while self.written[USART2_CR1] & 1 << 7:
            self.interrupt(USART2_IRQ)
        return bytes(self.sent)

    def _run(self, address: int, instructions: int) -> None:
        self._cpu.emu_start(address, 0, count=instructions)

    def _word(self, address: int) -> int:
        return int.from_bytes(self._cpu.mem_read(address, 4), "little")

    def _put(self, register: int, value: int) -> None:
        self._cpu.mem_write(register, value.to_bytes(4, "little"))

    def _device(
        self, _cpu: object, access: int, address: int, _size: int, value: int, _: object
    ) -> None:
        if access == self._u.UC_MEM_WRITE:
            self.written[address] = value
            if address == USART2_DR:
                self.sent.append(value & 0xFF)
        elif address == RCC_CFGR:
            clock = self.written.get(address, 0)
            self._put(address, clock | (clock & 3) << 2)  # the switch is done
