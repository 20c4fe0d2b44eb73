/* SPDX-License-Identifier: Apache-2.0 */
/* XCP commands for sample lists, one function per command. */
#include <stddef.h>

#include "app/request.h"
#include "xcp/command.h"
#include "xcp/memory.h"

#define DAQ_IS_DYNAMIC 0x01U
#define DAQ_HAS_PRESCALER 0x02U
#define DAQ_HAS_STAMP 0x10U
#define DAQ_OVERLOAD_IS_EVENT 0x80U
#define DAQ_RELATIVE_PART_BYTE_LIST 0x40U /* a 2-byte packet number precedes the sample */
#define STAMP_IS_FIXED_4_BYTES 0x0CU
#define EVENT_IS_DAQ 0x04U
#define EVENT_IS_CONSISTENT 0x80U /* all signals of a sample belong to one tick */
#define LIST_UNSUPPORTED_MODES 0x23U

/* Returns the tick period as a rounded number, at most `max_value`, times 10^power ns. */
static uint16_t find_tick_period(uint32_t rate, uint16_t max_value, uint8_t *power)
{
  uint32_t second = 1000000000U;
  uint32_t ticks = (second + rate / 2U) / rate;
  *power = 0;
  while (ticks > max_value) {
    second /= 10U;
    ticks = (second + rate / 2U) / rate;
    (*power)++;
  }
  return (uint16_t)ticks;
}

static uint8_t on_daq_processor(xcp_slave *x, xcp_request *r)
{
  r->answer[1] = DAQ_IS_DYNAMIC | DAQ_HAS_PRESCALER | DAQ_HAS_STAMP | DAQ_OVERLOAD_IS_EVENT;
  link_put_u16(r->answer + 2, x->daq.lists);
  link_put_u16(r->answer + 4, 1); /* number of events */
  r->answer[7] = DAQ_RELATIVE_PART_BYTE_LIST;
  r->length = 8;
  return XCP_OK;
}

static uint8_t on_daq_resolution(xcp_slave *x, xcp_request *r)
{
  uint8_t power = 0;
  const uint16_t ticks = find_tick_period(x->firmware->board->rate, UINT16_MAX, &power);
  r->answer[1] = 4; /* size of an entry in bytes: one signal */
  r->answer[2] = 4;
  r->answer[5] = (uint8_t)(STAMP_IS_FIXED_4_BYTES | ((uint8_t)(power << 4)));
  link_put_u16(r->answer + 6, ticks);
  r->length = 8;
  return XCP_OK;
}

static uint8_t on_daq_event(xcp_slave *x, xcp_request *r)
{
  uint8_t power = 0;
  if (link_get_u16(r->command + 2) != 0U) {
    return XCP_ERR_RANGE;
  }
  const uint16_t cycle = find_tick_period(x->firmware->board->rate, 255, &power);
  x->address = (uint32_t)XCP_AREA_EVENT << 16;
  r->answer[1] = EVENT_IS_DAQ | EVENT_IS_CONSISTENT;
  r->answer[2] = XCP_LISTS;
  r->answer[3] = (uint8_t)(sizeof XCP_EVENT - 1U);
  r->answer[4] = (uint8_t)cycle;
  r->answer[5] = power;
  r->length = 7;
  return XCP_OK;
}

static uint8_t on_daq_clock(xcp_slave *x, xcp_request *r)
{
  link_put_u32(r->answer + 4, app_last_tick(x->firmware));
  r->length = 8;
  return XCP_OK;
}

static uint8_t on_daq_free(xcp_slave *x, xcp_request *r)
{
  (void)r;
  xcp_daq_free(&x->daq);
  return XCP_OK;
}

static uint8_t on_daq_alloc(xcp_slave *x, xcp_request *r)
{
  return xcp_daq_alloc_lists(&x->daq, link_get_u16(r->command + 2));
}

static uint8_t on_daq_alloc_parts(xcp_slave *x, xcp_request *r)
{
  return xcp_daq_alloc_parts(&x->daq, link_get_u16(r->command + 2), r->command[4]);
}

static uint8_t on_daq_alloc_entries(xcp_slave *x, xcp_request *r)
{
  return xcp_daq_alloc_entries(&x->daq, link_get_u16(r->command + 2), r->command[4], r->command[5]);
}

static uint8_t on_daq_point(xcp_slave *x, xcp_request *r)
{
  return xcp_daq_set_position(&x->daq, link_get_u16(r->command + 2), r->command[4], r->command[5]);
}

static uint8_t on_daq_write(xcp_slave *x, xcp_request *r)
{
  const uint8_t signal = xcp_signal_at(link_get_u32(r->command + 4));
  if (r->command[1] != 0xFFU || r->command[2] != 4U || r->command[3] != 0U ||
      signal == XCP_NO_SIGNAL) {
    return XCP_ERR_RANGE; /* an entry is a complete signal, not a single bit */
  }
  return xcp_daq_write(&x->daq, signal);
}

static uint8_t on_daq_clear(xcp_slave *x, xcp_request *r)
{
  return xcp_daq_clear(&x->daq, link_get_u16(r->command + 2));
}

static uint8_t on_daq_mode(xcp_slave *x, xcp_request *r)
{
  if ((r->command[1] & LIST_UNSUPPORTED_MODES) != 0U) {
    return XCP_ERR_MODE;
  }
  if (link_get_u16(r->command + 4) != 0U) {
    return XCP_ERR_RANGE;
  }
  return xcp_daq_set_prescaler(&x->daq, link_get_u16(r->command + 2), r->command[6]);
}

static uint8_t on_daq_start_stop(xcp_slave *x, xcp_request *r)
{
  r->length = 2; /* first packet number of a list: always 0 */
  return xcp_daq_start_stop(&x->daq, link_get_u16(r->command + 2), r->command[1]);
}

static uint8_t on_daq_synchronise(xcp_slave *x, xcp_request *r)
{
  return xcp_daq_synchronise(&x->daq, r->command[1]);
}

static const xcp_command list_commands[] = {
    {0xE3, 4, 0, on_daq_clear},       {0xE2, 6, 0, on_daq_point},
    {0xE1, 8, 0, on_daq_write},       {0xE0, 8, 0, on_daq_mode},
    {0xDE, 4, 0, on_daq_start_stop},  {0xDD, 2, 0, on_daq_synchronise},
    {0xDC, 1, 0, on_daq_clock},       {0xDA, 1, 0, on_daq_processor},
    {0xD9, 1, 0, on_daq_resolution},  {0xD7, 4, 0, on_daq_event},
    {0xD6, 1, 0, on_daq_free},        {0xD5, 4, 0, on_daq_alloc},
    {0xD4, 5, 0, on_daq_alloc_parts}, {0xD3, 6, 0, on_daq_alloc_entries},
};

const xcp_command *xcp_daq_command(uint8_t code)
{
  const xcp_command *found = NULL;
  for (size_t i = 0; i < sizeof list_commands / sizeof list_commands[0]; i++) {
    if (list_commands[i].code == code) {
      found = &list_commands[i];
    }
  }
  return found;
}
