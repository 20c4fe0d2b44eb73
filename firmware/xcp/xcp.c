/* SPDX-License-Identifier: Apache-2.0 */
/* XCP commands for session, memory and pages, one function per command. Numbers: low byte first. */
#include "xcp/xcp.h"

#include <stddef.h>

#include "app/request.h"
#include "link/crc.h"
#include "xcp/command.h"
#include "xcp/memory.h"

#define PACKET_ANSWER 0xFFU
#define PACKET_ERROR 0xFEU
#define PACKET_EVENT 0xFDU
#define EVENT_OVERLOAD 0x06U

#define OPTIONAL_COMM_MODE 0x80U
#define RESOURCE_CALIBRATION 0x01U
#define RESOURCE_DAQ 0x04U
#define STATUS_DAQ_RUNNING 0x40U

#define PAGE_OF_ECU 0x01U
#define PAGE_OF_MASTER 0x02U
#define PAGE_OF_ALL 0x80U

#define CHECKSUM_CRC_32 0x09U
#define KEY_BYTES 4U

void xcp_disconnect(xcp_slave *x)
{
  x->is_connected = 0;
  x->is_unlocked = 0;
  x->has_seed = 0;
  x->page = 0;
  x->reported_losses = 0;
  xcp_daq_start(&x->daq);
}

void xcp_start(xcp_slave *x, app *firmware)
{
  x->firmware = firmware;
  x->daq.port = firmware->port;
  x->address = 0;
  x->seed = 0;
  x->is_swapped = 0;
  xcp_disconnect(x);
}

void xcp_tick(xcp_slave *x)
{
  xcp_daq_tick(&x->daq, x->firmware->control.tick, x->firmware->signals);
}

uint16_t xcp_take(xcp_slave *x, uint8_t *packet, uint16_t size)
{
  port_lock(x->firmware->port);
  const uint16_t lost = x->daq.dropped_samples;
  port_unlock(x->firmware->port);
  if ((lost != x->reported_losses) && (size >= 2U)) {
    x->reported_losses = lost;
    packet[0] = PACKET_EVENT;
    packet[1] = EVENT_OVERLOAD;
    return 2;
  }
  return xcp_daq_take(&x->daq, packet, size);
}

static uint8_t on_connect(xcp_slave *x, xcp_request *r)
{
  xcp_disconnect(x); /* a second connect restarts the session */
  x->is_connected = 1;
  r->answer[1] = RESOURCE_CALIBRATION | RESOURCE_DAQ;
  r->answer[2] =
      OPTIONAL_COMM_MODE; /* byte order low first, address unit byte, no block transfer */
  r->answer[3] = XCP_PACKET;
  link_put_u16(r->answer + 4, XCP_PACKET);
  r->answer[6] = 1; /* versions of the protocol and transport layers */
  r->answer[7] = 1;
  r->length = 8;
  return XCP_OK;
}

static uint8_t on_disconnect(xcp_slave *x, xcp_request *r)
{
  (void)r;
  xcp_disconnect(x);
  return XCP_OK;
}

static uint8_t protected_resources(const xcp_slave *x)
{
  return (uint8_t)(x->is_unlocked != 0U ? 0U : RESOURCE_CALIBRATION);
}

static uint8_t on_status(xcp_slave *x, xcp_request *r)
{
  r->answer[1] = xcp_daq_is_running(&x->daq) ? (uint8_t)STATUS_DAQ_RUNNING : (uint8_t)0;
  r->answer[2] = protected_resources(x);
  r->length = 6;
  return XCP_OK;
}

/* The answer to SYNCH is an error packet. It shows that both sides are synchronised again. */
static uint8_t on_synch(xcp_slave *x, xcp_request *r)
{
  (void)x;
  r->answer[0] = PACKET_ERROR;
  r->length = 2;
  return XCP_OK;
}

/* There is no block mode and no interleaved mode. */
static uint8_t on_comm_mode_info(xcp_slave *x, xcp_request *r)
{
  r->answer[7] = (uint8_t)(x->firmware->board->firmware & 0xFFU);
  r->length = 8;
  return XCP_OK;
}

static uint32_t text_length(const char *text)
{
  uint32_t length = 0;
  while (text[length] != '\0') {
    length++;
  }
  return length;
}

/* The master reads the name with UPLOAD. Type 0 is a text, type 1 a file name without extension. */
static uint8_t on_id(xcp_slave *x, xcp_request *r)
{
  x->address = (uint32_t)XCP_AREA_NAME << 16;
  link_put_u32(r->answer + 4, r->command[1] <= 1U ? text_length(x->firmware->board->name) : 0U);
  r->length = 8;
  return XCP_OK;
}

static uint8_t on_seed(xcp_slave *x, xcp_request *r)
{
  if (r->command[1] != 0U) {
    return XCP_ERR_SEQUENCE; /* the seed has only one part */
  }
  r->length = 2;
  if (x->is_unlocked != 0U || r->command[2] != RESOURCE_CALIBRATION) {
    return XCP_OK;
  }
  uint8_t tick[KEY_BYTES];
  link_put_u32(tick, app_last_tick(x->firmware));
  x->seed = link_crc32(x->seed + 1U, tick, KEY_BYTES);
  x->has_seed = 1;
  r->answer[1] = KEY_BYTES;
  link_put_u32(r->answer + 2, x->seed);
  r->length = 2U + KEY_BYTES;
  return XCP_OK;
}

/* A wrong key ends the connection. */
static uint8_t on_unlock(xcp_slave *x, xcp_request *r)
{
  uint8_t seed[KEY_BYTES];
  if (x->has_seed == 0U) {
    return XCP_ERR_SEQUENCE;
  }
  x->has_seed = 0;
  link_put_u32(seed, x->seed);
  if (r->command[1] != KEY_BYTES || r->count < 2U + KEY_BYTES ||
      link_get_u32(r->command + 2) != link_crc32(XCP_SECRET, seed, KEY_BYTES)) {
    xcp_disconnect(x);
    return XCP_ERR_LOCKED;
  }
  x->is_unlocked = 1;
  r->answer[1] = protected_resources(x);
  r->length = 2;
  return XCP_OK;
}

static uint8_t on_address(xcp_slave *x, xcp_request *r)
{
  if (r->command[3] != 0U) {
    return XCP_ERR_RANGE; /* there are no address extensions */
  }
  x->address = link_get_u32(r->command + 4);
  return XCP_OK;
}

static uint8_t on_upload(xcp_slave *x, xcp_request *r)
{
  const uint8_t count = r->command[1];
  if (count == 0U || count > XCP_PACKET - 1U) {
    return XCP_ERR_RANGE;
  }
  const uint8_t error = xcp_read(x, x->address, r->answer + 1, count);
  if (error == XCP_OK) {
    x->address += count;
    r->length = (uint16_t)(count + 1U);
  }
  return error;
}

static uint8_t on_short_upload(xcp_slave *x, xcp_request *r)
{
  const uint8_t error = on_address(x, r);
  return error == XCP_OK ? on_upload(x, r) : error;
}

/* Writes the bytes of the command from index `from` on. */
static uint8_t download(xcp_slave *x, xcp_request *r, uint16_t from)
{
  const uint16_t count = r->command[1];
  uint8_t error = XCP_ERR_SYNTAX;
  if (count <= (uint16_t)(r->count - from)) {
    error = xcp_write(x, x->address, r->command + from, count, &r->reason);
  }
  if (error == XCP_OK) {
    x->address += count;
  }
  return error;
}

static uint8_t on_download(xcp_slave *x, xcp_request *r) { return download(x, r, 2); }

/* Address and bytes are in one command, so that a demand needs one round trip instead of two. */
static uint8_t on_short_download(xcp_slave *x, xcp_request *r)
{
  const uint8_t error = on_address(x, r);
  return error == XCP_OK ? download(x, r, 8) : error;
}

static uint8_t on_checksum(xcp_slave *x, xcp_request *r)
{
  const uint32_t size = link_get_u32(r->command + 4);
  uint8_t bytes[32];
  uint32_t sum = 0;
  if (size == 0U || size > 0x10000U - (x->address & 0xFFFFU)) {
    return XCP_ERR_RANGE;
  }
  for (uint32_t at = 0; at < size; at += sizeof bytes) {
    const uint16_t chunk = (uint16_t)(size - at < sizeof bytes ? size - at : sizeof bytes);
    const uint8_t error = xcp_read(x, x->address + at, bytes, chunk);
    if (error != XCP_OK) {
      return error;
    }
    sum = link_crc32(sum, bytes, chunk);
  }
  x->address += size;
  r->answer[1] = CHECKSUM_CRC_32;
  link_put_u32(r->answer + 4, sum);
  r->length = 8;
  return XCP_OK;
}

static uint8_t on_set_page(xcp_slave *x, xcp_request *r)
{
  uint16_t detail = 0;
  if ((r->command[1] & PAGE_OF_ALL) == 0U && r->command[2] != 0U) {
    return XCP_ERR_SEGMENT;
  }
  if ((r->command[1] & (PAGE_OF_ECU | PAGE_OF_MASTER)) == 0U) {
    return XCP_ERR_MODE;
  }
  if (r->command[3] > 1U) {
    return XCP_ERR_PAGE;
  }
  if ((r->command[1] & PAGE_OF_ECU) != 0U) {
    if (r->command[3] == 1U) {
      r->reason = app_block_swap_edited(x->firmware, &detail);
      if (r->reason != LINK_REASON_NONE) {
        return XCP_ERR_PAGE;
      }
    }
    x->is_swapped = r->command[3];
  }
  if ((r->command[1] & PAGE_OF_MASTER) != 0U) {
    x->page = r->command[3];
  }
  return XCP_OK;
}

static uint8_t on_page(xcp_slave *x, xcp_request *r)
{
  if (r->command[2] != 0U) {
    return XCP_ERR_SEGMENT;
  }
  if (r->command[1] != PAGE_OF_ECU && r->command[1] != PAGE_OF_MASTER) {
    return XCP_ERR_MODE;
  }
  r->answer[3] = r->command[1] == PAGE_OF_ECU ? x->is_swapped : x->page;
  r->length = 4;
  return XCP_OK;
}

static uint8_t on_page_info(xcp_slave *x, xcp_request *r)
{
  (void)x;
  r->answer[1] = 1; /* number of segments */
  r->length = 3;
  return XCP_OK;
}

/* Copies page 0 to page 1; this discards the edits of page 1. */
static uint8_t on_copy_page(xcp_slave *x, xcp_request *r)
{
  if (r->command[1] != 0U || r->command[3] != 0U) {
    return XCP_ERR_SEGMENT;
  }
  if (r->command[4] == 0U) {
    return XCP_ERR_WRITE_PROTECTED;
  }
  if (r->command[2] != 0U || r->command[4] != 1U) {
    return XCP_ERR_PAGE;
  }
  app_block_discard_edits(x->firmware);
  return XCP_OK;
}

static const xcp_command commands[] = {
    {0xFF, 2, 0, on_connect},  {0xFE, 1, 0, on_disconnect},     {0xFD, 1, 0, on_status},
    {0xFC, 1, 0, on_synch},    {0xFB, 1, 0, on_comm_mode_info}, {0xFA, 2, 0, on_id},
    {0xF8, 3, 0, on_seed},     {0xF7, 2, 0, on_unlock},         {0xF6, 8, 0, on_address},
    {0xF5, 2, 0, on_upload},   {0xF4, 8, 0, on_short_upload},   {0xF3, 8, 0, on_checksum},
    {0xF0, 2, 1, on_download}, {0xED, 8, 1, on_short_download}, {0xEB, 4, 1, on_set_page},
    {0xEA, 3, 0, on_page},     {0xE9, 1, 0, on_page_info},      {0xE4, 5, 1, on_copy_page},
};

static uint8_t perform_command(xcp_slave *x, xcp_request *r)
{
  const xcp_command *found = xcp_daq_command(r->command[0]);
  for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
    if (commands[i].code == r->command[0]) {
      found = &commands[i];
    }
  }
  if (found == NULL) {
    return XCP_ERR_UNKNOWN_COMMAND;
  }
  if (r->count < found->min_bytes || r->count > XCP_PACKET) {
    return XCP_ERR_SYNTAX;
  }
  if (found->needs_key != 0U && x->is_unlocked == 0U) {
    return XCP_ERR_LOCKED;
  }
  return found->act(x, r);
}

uint16_t xcp_answer(xcp_slave *x, const uint8_t *command, uint16_t length, uint8_t *answer)
{
  xcp_request r = {command, length, answer, 1, LINK_REASON_NONE};
  if (length == 0U || (x->is_connected == 0U && command[0] != 0xFFU)) {
    return 0;
  }
  if (x->is_unlocked != 0U) {
    app_restart_heartbeat(x->firmware);
  }
  answer[0] = PACKET_ANSWER;
  for (uint16_t i = 1; i < XCP_CLEARED_ANSWER_BYTES; i++) {
    answer[i] = 0;
  }
  const uint8_t error = perform_command(x, &r);
  if (error == XCP_OK) {
    return r.length;
  }
  answer[0] = PACKET_ERROR;
  answer[1] = error;
  link_put_u16(answer + 2, r.reason);
  return r.reason != LINK_REASON_NONE ? 4U : 2U;
}
