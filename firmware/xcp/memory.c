/* SPDX-License-Identifier: Apache-2.0 */
#include "xcp/memory.h"

#include <stddef.h>

#include "app/request.h"

static uint16_t address_area(uint32_t address) { return (uint16_t)(address >> 16); }

static uint16_t address_offset(uint32_t address) { return (uint16_t)(address & 0xFFFFU); }

/* Returns the number of bytes per value of an area. */
static uint16_t bytes_per_value(uint16_t area)
{
  switch (area) {
  case XCP_AREA_SIGNAL:
  case XCP_AREA_SETTING:
  case XCP_AREA_INPUT:
    return 4;
  case XCP_AREA_BLOCK:
    return 2;
  default:
    return 1;
  }
}

static uint8_t read_signal(const xcp_slave *x, uint16_t number, uint32_t *value)
{
  if (number >= (uint16_t)LINK_SIGNAL_COUNT) {
    return XCP_ERR_RANGE;
  }
  port_lock(x->firmware->port);
  *value = (uint32_t)x->firmware->signals[number];
  port_unlock(x->firmware->port);
  return XCP_OK;
}

/* Whether the body accepts this input, which is a force or a position. */
static int accepts_input(const xcp_slave *x, uint16_t number)
{
  const int levitates = x->firmware->board->plan != NULL;
  return number == (uint16_t)XCP_INPUT_SET_TARGET ? levitates : !levitates;
}

static uint8_t read_input(const xcp_slave *x, uint16_t number, uint32_t *value)
{
  if (number >= (uint16_t)XCP_INPUT_COUNT) {
    return XCP_ERR_RANGE;
  }
  if (number == (uint16_t)XCP_INPUT_COMMAND) {
    *value = ANHYST_COMMAND_NONE;
    return XCP_OK;
  }
  if (!accepts_input(x, number)) {
    return XCP_ERR_DENIED;
  }
  port_lock(x->firmware->port);
  *value = (uint32_t)app_body_goal(x->firmware->control.body);
  port_unlock(x->firmware->port);
  return XCP_OK;
}

static uint8_t read_block_word(const xcp_slave *x, uint16_t number, uint32_t *value)
{
  const int16_t *edited = x->page == 1U ? app_edited_block(x->firmware) : NULL;
  const uint16_t length = edited != NULL ? (uint16_t)ANHYST_BLOCK_MOST_WORDS
                                         : app_active_word(x->firmware, ANHYST_WORD_LENGTH);
  if (number >= length) {
    return XCP_ERR_RANGE;
  }
  *value = edited != NULL ? (uint16_t)edited[number] : app_active_word(x->firmware, number);
  return XCP_OK;
}

static uint8_t read_character(const char *text, uint16_t number, uint32_t *value)
{
  for (uint16_t i = 0; i <= number; i++) {
    if (text[i] == '\0') {
      return XCP_ERR_RANGE;
    }
  }
  *value = (uint8_t)text[number];
  return XCP_OK;
}

/* Reads the value with this number in an area. */
static uint8_t read_value(const xcp_slave *x, uint16_t area, uint16_t number, uint32_t *value)
{
  switch (area) {
  case XCP_AREA_SIGNAL:
    return read_signal(x, number, value);
  case XCP_AREA_SETTING:
    if (number >= (uint16_t)LINK_SETTING_COUNT) {
      return XCP_ERR_RANGE;
    }
    *value = (uint32_t)x->firmware->settings[number];
    return XCP_OK;
  case XCP_AREA_INPUT:
    return read_input(x, number, value);
  case XCP_AREA_BLOCK:
    return read_block_word(x, number, value);
  case XCP_AREA_NAME:
    return read_character(x->firmware->board->name, number, value);
  case XCP_AREA_EVENT:
    return read_character(XCP_EVENT, number, value);
  default:
    return XCP_ERR_DENIED;
  }
}

uint8_t xcp_read(const xcp_slave *x, uint32_t address, uint8_t *bytes, uint32_t count)
{
  const uint16_t area = address_area(address);
  const uint16_t width = bytes_per_value(area);
  uint32_t value = 0;
  if (count > 0x10000U - address_offset(address)) {
    return XCP_ERR_RANGE;
  }
  for (uint32_t i = 0; i < count; i++) {
    const uint16_t at = (uint16_t)(address_offset(address) + i);
    const uint16_t byte = at % width;
    if (i == 0U || byte == 0U) { /* the value is read only once, so that its bytes are consistent */
      const uint8_t error = read_value(x, area, at / width, &value);
      if (error != XCP_OK) {
        return error;
      }
      for (uint16_t shifts = byte; shifts > 0U; shifts--) {
        value >>= 8;
      }
    }
    bytes[i] = (uint8_t)(value & 0xFFU);
    value >>= 8;
  }
  return XCP_OK;
}

static uint16_t write_input(xcp_slave *x, uint16_t number, int32_t value)
{
  app *a = x->firmware;
  uint16_t state = 0;
  switch (number) {
  case XCP_INPUT_SET_DEMAND:
    return app_set_reference(a, LINK_BODY_FORCE, value);
  case XCP_INPUT_SET_TARGET:
    return app_set_reference(a, LINK_BODY_POSITION, value);
  case XCP_INPUT_COMMAND:
    return value >= 0 && value < (int32_t)ANHYST_COMMAND_COUNT
               ? app_command(a, (uint16_t)value, &state)
               : (uint16_t)LINK_REASON_VALUE;
  default:
    return LINK_REASON_VALUE;
  }
}

uint8_t xcp_write(xcp_slave *x, uint32_t address, const uint8_t *bytes, uint16_t count,
                  uint16_t *reason)
{
  const uint16_t area = address_area(address);
  const uint16_t width = bytes_per_value(area);
  const uint16_t number = address_offset(address) / width;
  uint16_t state = 0;
  *reason = LINK_REASON_NONE;
  if (address_offset(address) % width != 0U || count % width != 0U || count == 0U ||
      (width == 4U && count != 4U)) {
    return XCP_ERR_RANGE;
  }
  switch (area) {
  case XCP_AREA_SETTING:
    *reason = app_setting_write(x->firmware, number, link_get_i32(bytes), &state);
    break;
  case XCP_AREA_INPUT:
    *reason = write_input(x, number, link_get_i32(bytes));
    break;
  case XCP_AREA_BLOCK:
    if (x->page != 1U) {
      return XCP_ERR_WRITE_PROTECTED;
    }
    x->is_swapped = 0;
    *reason = app_block_edit(x->firmware, number, bytes, count / 2U);
    break;
  default:
    return XCP_ERR_WRITE_PROTECTED;
  }
  if (*reason == LINK_REASON_NONE) {
    return XCP_OK;
  }
  return *reason == LINK_REASON_VALUE ? XCP_ERR_RANGE : XCP_ERR_DENIED;
}

uint8_t xcp_signal_at(uint32_t address)
{
  const uint16_t number = address_offset(address) / 4U;
  if (address_area(address) != (uint16_t)XCP_AREA_SIGNAL || address_offset(address) % 4U != 0U ||
      number >= (uint16_t)LINK_SIGNAL_COUNT) {
    return XCP_NO_SIGNAL;
  }
  return (uint8_t)number;
}
