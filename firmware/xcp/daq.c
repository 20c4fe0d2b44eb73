/* SPDX-License-Identifier: Apache-2.0 */
#include "xcp/daq.h"

/* Stages of the allocation. Each call repeats the present stage or advances to the next stage. */
enum { STAGE_FREE, STAGE_LISTS, STAGE_PARTS, STAGE_ENTRIES };

void xcp_daq_free(xcp_daq *d)
{
  port_lock(d->port);
  for (uint8_t i = 0; i < (uint8_t)XCP_LISTS; i++) {
    d->list[i].is_running = 0;
    d->list[i].is_selected = 0;
  }
  port_unlock(d->port);
  d->allocation_stage = STAGE_FREE;
  d->lists = 0;
  d->parts = 0;
  d->entries = 0;
  d->next_list = 0;
  d->next_part = 0;
  d->next_entry = 0;
}

void xcp_daq_start(xcp_daq *d)
{
  xcp_daq_free(d);
  port_lock(d->port);
  d->dropped_samples = 0;
  d->head = 0;
  d->tail = 0;
  port_unlock(d->port);
}

int xcp_daq_is_running(const xcp_daq *d)
{
  int is_running = 0;
  for (uint8_t i = 0; i < d->lists; i++) {
    is_running = is_running || d->list[i].is_running != 0U;
  }
  return is_running;
}

static uint16_t next_index(uint16_t at) { return at + 1U < (uint16_t)XCP_QUEUE ? at + 1U : 0U; }

static uint16_t free_bytes(const xcp_daq *d)
{
  const uint16_t used = d->head >= d->tail ? (uint16_t)(d->head - d->tail)
                                           : (uint16_t)(d->head + (uint16_t)XCP_QUEUE - d->tail);
  return (uint16_t)((uint16_t)XCP_QUEUE - 1U - used);
}

static void queue_byte(xcp_daq *d, uint8_t byte)
{
  d->queue[d->head] = byte;
  d->head = next_index(d->head);
}

static void queue_u32(xcp_daq *d, uint32_t value)
{
  uint8_t bytes[4];
  link_put_u32(bytes, value);
  for (uint8_t i = 0; i < 4U; i++) {
    queue_byte(d, bytes[i]);
  }
}

uint16_t xcp_daq_take(xcp_daq *d, uint8_t *packet, uint16_t size)
{
  port_lock(d->port);
  const uint16_t head = d->head;
  port_unlock(d->port);
  uint16_t at = d->tail;
  if (at == head) {
    return 0;
  }
  const uint8_t length = d->queue[at];
  if (length > size) {
    return 0;
  }
  at = next_index(at);
  for (uint8_t i = 0; i < length; i++) {
    packet[i] = d->queue[at];
    at = next_index(at);
  }
  port_lock(d->port);
  d->tail = at;
  port_unlock(d->port);
  return length;
}

static uint8_t packet_size(const xcp_daq *d, uint8_t list, uint8_t part)
{
  const uint8_t number = (uint8_t)(d->list[list].parts.first + part);
  const uint8_t stamp = part == 0U ? (uint8_t)XCP_DAQ_TIMESTAMP_BYTES : 0U;
  return (uint8_t)(XCP_DAQ_HEADER_BYTES + stamp + 4U * d->part[number].count);
}

static void queue_sample(xcp_daq *d, uint8_t number, uint32_t tick, const int32_t *signals)
{
  const xcp_list *list = &d->list[number];
  uint16_t needed_bytes = 0;
  for (uint8_t part = 0; part < list->parts.count; part++) {
    needed_bytes = (uint16_t)(needed_bytes + 1U + packet_size(d, number, part));
  }
  if (needed_bytes > free_bytes(d)) {
    d->dropped_samples++;
    return;
  }
  for (uint8_t part = 0; part < list->parts.count; part++) {
    const xcp_range *entries = &d->part[list->parts.first + part];
    queue_byte(d, packet_size(d, number, part));
    queue_byte(d, part);
    queue_byte(d, number);
    if (part == 0U) {
      queue_u32(d, tick);
    }
    for (uint8_t i = 0; i < entries->count; i++) {
      queue_u32(d, (uint32_t)signals[d->signal[entries->first + i]]);
    }
  }
}

void xcp_daq_tick(xcp_daq *d, uint32_t tick, const int32_t *signals)
{
  for (uint8_t i = 0; i < d->lists; i++) {
    xcp_list *list = &d->list[i];
    if (list->is_running == 0U) {
      continue;
    }
    if (list->remaining_ticks > 0U) {
      list->remaining_ticks--;
    } else {
      list->remaining_ticks = (uint8_t)(list->prescaler - 1U);
      queue_sample(d, i, tick, signals);
    }
  }
}

/* Checks that no list is running and that the allocation may continue with this stage. */
static uint8_t check_allocation(xcp_daq *d, uint8_t stage)
{
  if (xcp_daq_is_running(d)) {
    return XCP_ERR_DAQ_ACTIVE;
  }
  if (d->allocation_stage != stage && d->allocation_stage + 1U != stage) {
    return XCP_ERR_SEQUENCE;
  }
  return XCP_OK;
}

uint8_t xcp_daq_alloc_lists(xcp_daq *d, uint16_t count)
{
  if (d->allocation_stage != STAGE_FREE || d->lists != 0U) {
    return XCP_ERR_SEQUENCE;
  }
  if (count > (uint16_t)XCP_LISTS) {
    return XCP_ERR_NO_MEMORY;
  }
  for (uint16_t i = 0; i < count; i++) {
    const xcp_list new_list = {{0, 0}, 1, 0, 0, 0};
    d->list[i] = new_list;
  }
  d->lists = (uint8_t)count;
  d->allocation_stage = STAGE_LISTS;
  return XCP_OK;
}

uint8_t xcp_daq_alloc_parts(xcp_daq *d, uint16_t list, uint8_t count)
{
  const uint8_t error = check_allocation(d, STAGE_PARTS);
  if (error != XCP_OK) {
    return error;
  }
  if (list >= d->lists) {
    return XCP_ERR_RANGE;
  }
  if (d->list[list].parts.count != 0U) {
    return XCP_ERR_SEQUENCE;
  }
  if (count > (uint8_t)XCP_ODTS - d->parts) {
    return XCP_ERR_NO_MEMORY;
  }
  d->list[list].parts.first = d->parts;
  d->list[list].parts.count = count;
  for (uint8_t i = 0; i < count; i++) {
    d->part[d->parts].first = 0;
    d->part[d->parts].count = 0;
    d->parts++;
  }
  d->allocation_stage = STAGE_PARTS;
  return XCP_OK;
}

uint8_t xcp_daq_alloc_entries(xcp_daq *d, uint16_t list, uint8_t part, uint8_t count)
{
  const uint8_t error = check_allocation(d, STAGE_ENTRIES);
  if (error != XCP_OK) {
    return error;
  }
  if (list >= d->lists || part >= d->list[list].parts.count) {
    return XCP_ERR_RANGE;
  }
  xcp_range *entries = &d->part[d->list[list].parts.first + part];
  if (entries->count != 0U) {
    return XCP_ERR_SEQUENCE;
  }
  if (count > (uint8_t)XCP_ENTRIES - d->entries) {
    return XCP_ERR_NO_MEMORY;
  }
  entries->first = d->entries;
  entries->count = count;
  for (uint8_t i = 0; i < count; i++) {
    d->signal[d->entries] = XCP_NO_SIGNAL;
    d->entries++;
  }
  d->allocation_stage = STAGE_ENTRIES;
  return XCP_OK;
}

uint8_t xcp_daq_set_position(xcp_daq *d, uint16_t list, uint8_t part, uint8_t entry)
{
  if (xcp_daq_is_running(d)) {
    return XCP_ERR_DAQ_ACTIVE;
  }
  if (list >= d->lists || part >= d->list[list].parts.count ||
      entry >= d->part[d->list[list].parts.first + part].count) {
    return XCP_ERR_RANGE;
  }
  d->next_list = (uint8_t)list;
  d->next_part = (uint8_t)(d->list[list].parts.first + part);
  d->next_entry = entry;
  return XCP_OK;
}

uint8_t xcp_daq_write(xcp_daq *d, uint8_t signal)
{
  if (xcp_daq_is_running(d)) {
    return XCP_ERR_DAQ_ACTIVE;
  }
  if (d->next_part >= d->parts || d->next_entry >= d->part[d->next_part].count) {
    return XCP_ERR_DAQ_CONFIG;
  }
  d->signal[d->part[d->next_part].first + d->next_entry] = signal;
  d->next_entry++;
  return XCP_OK;
}

static void set_running(xcp_daq *d, uint16_t list, uint8_t running)
{
  port_lock(d->port);
  d->list[list].remaining_ticks = 0;
  d->list[list].is_running = running;
  port_unlock(d->port);
}

uint8_t xcp_daq_clear(xcp_daq *d, uint16_t list)
{
  if (list >= d->lists) {
    return XCP_ERR_RANGE;
  }
  set_running(d, list, 0);
  for (uint8_t i = 0; i < d->list[list].parts.count; i++) {
    const xcp_range *entries = &d->part[d->list[list].parts.first + i];
    for (uint8_t j = 0; j < entries->count; j++) {
      d->signal[entries->first + j] = XCP_NO_SIGNAL;
    }
  }
  return XCP_OK;
}

uint8_t xcp_daq_set_prescaler(xcp_daq *d, uint16_t list, uint8_t prescaler)
{
  if (list >= d->lists || prescaler == 0U) {
    return XCP_ERR_RANGE;
  }
  if (d->list[list].is_running != 0U) {
    return XCP_ERR_DAQ_ACTIVE;
  }
  d->list[list].prescaler = prescaler;
  return XCP_OK;
}

/* Whether a list has packets, and all its entries were written. */
static int is_complete(const xcp_daq *d, uint16_t list)
{
  const xcp_range *parts = &d->list[list].parts;
  int is_list_complete = parts->count > 0U;
  for (uint8_t i = 0; i < parts->count; i++) {
    const xcp_range *entries = &d->part[parts->first + i];
    for (uint8_t j = 0; j < entries->count; j++) {
      is_list_complete = is_list_complete && d->signal[entries->first + j] != XCP_NO_SIGNAL;
    }
  }
  return is_list_complete;
}

uint8_t xcp_daq_start_stop(xcp_daq *d, uint16_t list, uint8_t mode)
{
  if (list >= d->lists) {
    return XCP_ERR_RANGE;
  }
  if (mode > 2U) {
    return XCP_ERR_MODE;
  }
  if (mode != 0U && !is_complete(d, list)) {
    return XCP_ERR_DAQ_CONFIG;
  }
  if (mode == 2U) {
    d->list[list].is_selected = 1;
  } else {
    set_running(d, list, mode);
  }
  return XCP_OK;
}

uint8_t xcp_daq_synchronise(xcp_daq *d, uint8_t mode)
{
  if (mode > 2U) {
    return XCP_ERR_MODE;
  }
  /* One lock for all lists, so that they start with the same tick. */
  port_lock(d->port);
  for (uint8_t i = 0; i < d->lists; i++) {
    xcp_list *list = &d->list[i];
    if (mode == 0U || list->is_selected != 0U) {
      list->remaining_ticks = 0;
      list->is_running = mode == 1U ? 1U : 0U;
    }
    list->is_selected = 0;
  }
  port_unlock(d->port);
  return XCP_OK;
}
