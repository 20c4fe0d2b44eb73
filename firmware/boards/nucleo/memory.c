/* SPDX-License-Identifier: Apache-2.0 */
#include "memory.h"

#include "registers.h"
#include "services/store.h"

#define SECTOR 6U /* sectors 6 and 7, 128 KiB each; board.ld excludes them from the program */
#define SECTOR_ADDRESS 0x08040000U
#define SECTOR_BYTES 0x20000U
#define SET_WORDS (sizeof(memory_set) / sizeof(uint32_t))

/* Places a function in RAM, because the flash cannot be read while it is written. */
#define IN_RAM(name) __attribute__((section(".data.memory_" name), noinline))

/* Executes one flash command and waits for its end. Returns 1 if it succeeded. */
IN_RAM("work") static int run_command(uint32_t command, volatile uint32_t *at, uint32_t word)
{
  FLASH_SR = FLASH_SR_ERRORS;
  FLASH_CR = command;
  if (at != 0) {
    *at = word;
  } else {
    FLASH_CR = command | FLASH_CR_STRT;
  }
  while ((FLASH_SR & FLASH_SR_BSY) != 0U) {
    IWDG_KR = IWDG_KR_FEED;
  }
  IWDG_KR = IWDG_KR_FEED;
  const int done = (FLASH_SR & FLASH_SR_ERRORS) == 0U;
  FLASH_CR = FLASH_CR_LOCK;
  return done;
}

static void unlock(void)
{
  FLASH_KEYR = FLASH_KEY_1;
  FLASH_KEYR = FLASH_KEY_2;
}

static int erase(uint16_t copy)
{
  unlock();
  const int done =
      run_command(FLASH_CR_PSIZE_32 | FLASH_CR_SER | FLASH_CR_SNB(SECTOR + copy), 0, 0);
  /* Invalidates the caches, which may contain old data of the sector. */
  const uint32_t access = FLASH_ACR;
  FLASH_ACR = access & ~(FLASH_ACR_DCEN | FLASH_ACR_ICEN);
  FLASH_ACR = (access & ~(FLASH_ACR_DCEN | FLASH_ACR_ICEN)) | FLASH_ACR_DCRST | FLASH_ACR_ICRST;
  FLASH_ACR = access;
  return done;
}

static volatile uint32_t *sector(uint16_t copy)
{
  return (volatile uint32_t *)(uintptr_t)(SECTOR_ADDRESS + SECTOR_BYTES * copy);
}

static int program(uint16_t copy, uint32_t at, uint32_t word)
{
  unlock();
  return run_command(FLASH_CR_PSIZE_32 | FLASH_CR_PG, sector(copy) + at, word);
}

static store_flash flash_access(void)
{
  const store_flash flash = {
      {sector(0), sector(1)}, SECTOR_BYTES / sizeof(uint32_t), erase, program};
  return flash;
}

static int is_valid(const memory_set *set)
{
  return set->layout == MEMORY_LAYOUT && calibration_is_valid(&set->gap) &&
         calibration_is_valid(&set->force) && calibration_is_valid(&set->current) &&
         calibration_is_valid(&set->position) && set->words <= ANHYST_BLOCK_MOST_WORDS;
}

int memory_load(memory_set *set)
{
  const store_flash flash = flash_access();
  uint32_t count;
  const volatile uint32_t *stored = store_read(&flash, &count);
  if (stored == 0 || count != SET_WORDS || !is_valid((const memory_set *)(uintptr_t)stored)) {
    return 0;
  }
  for (uint32_t i = 0; i < SET_WORDS; i++) {
    ((uint32_t *)set)[i] = stored[i];
  }
  return 1;
}

int memory_save(const memory_set *set)
{
  const store_flash flash = flash_access();
  return store_write(&flash, (const uint32_t *)set, SET_WORDS);
}
