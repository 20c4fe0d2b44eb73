/* SPDX-License-Identifier: Apache-2.0 */
#include "xcp/line.h"

#include "app/request.h"

void xcp_line_disconnect(xcp_line *line)
{
  xcp_disconnect(&line->slave);
  line->ignores_bytes = 0;
  line->in_count = 0;
  line->out_count = 0;
  line->sent_count = 0;
  line->counter = 0;
}

void xcp_line_start(xcp_line *line, app *firmware, int has_checksum)
{
  xcp_start(&line->slave, firmware);
  line->has_checksum = (has_checksum != 0) ? 1U : 0U;
  line->last_received_tick = 0;
  xcp_line_disconnect(line);
}

void xcp_line_tick(xcp_line *line) { xcp_tick(&line->slave); }

/* Returns the number of bytes before the checksum, for a packet of this length. */
static uint16_t packet_end(const xcp_line *line, uint16_t length)
{
  const uint16_t padding = (line->has_checksum != 0U) ? (uint16_t)(length % 2U) : 0U;
  return (uint16_t)(XCP_LINE_HEADER_BYTES + length + padding);
}

static uint16_t sum_of_words(const uint8_t *bytes, uint16_t count)
{
  uint16_t sum = 0;
  for (uint16_t i = 0; i < count; i += 2U) {
    sum = (uint16_t)(sum + link_get_u16(&bytes[i]));
  }
  return sum;
}

/* Adds the header and the checksum to a packet in the output buffer. */
static void wrap_packet(xcp_line *line, uint16_t length)
{
  line->sent_count = 0;
  line->out_count = 0;
  if (length > 0U) {
    link_put_u16(line->out, length);
    link_put_u16(&line->out[2], line->counter);
    line->counter++;
    line->out_count = packet_end(line, length);
  }
  if ((length > 0U) && (line->has_checksum != 0U)) {
    line->out[XCP_LINE_HEADER_BYTES + length] =
        0; /* padding byte, or overwritten by the checksum */
    link_put_u16(&line->out[line->out_count], sum_of_words(line->out, line->out_count));
    line->out_count += XCP_LINE_CHECKSUM_BYTES;
  }
}

/* Processes the command once it is complete. A command with a wrong checksum is neither performed
   nor answered; the master repeats it. */
static void process_command(xcp_line *line)
{
  const uint16_t length = link_get_u16(line->in);
  const uint16_t end = packet_end(line, length);
  const uint16_t tail = (line->has_checksum != 0U) ? XCP_LINE_CHECKSUM_BYTES : 0U;
  line->ignores_bytes = ((length == 0U) || (length > (uint16_t)XCP_PACKET)) ? 1U : 0U;
  if ((line->ignores_bytes == 0U) && (line->in_count == (uint16_t)(end + tail))) {
    line->in_count = 0;
    if ((line->has_checksum == 0U) ||
        (sum_of_words(line->in, end) == link_get_u16(&line->in[end]))) {
      wrap_packet(line, xcp_answer(&line->slave, &line->in[XCP_LINE_HEADER_BYTES], length,
                                   &line->out[XCP_LINE_HEADER_BYTES]));
    }
  }
}

static void receive_byte(xcp_line *line, uint8_t byte)
{
  if (line->ignores_bytes == 0U) {
    line->in[line->in_count] = byte;
    line->in_count++;
    if (line->in_count >= XCP_LINE_HEADER_BYTES) {
      process_command(line);
    }
  }
}

/* Discards an incomplete command after a silence of the line. */
static void reset_after_silence(xcp_line *line)
{
  const app *firmware = line->slave.firmware;
  const uint32_t now = app_last_tick(firmware);
  const uint32_t silence = now - line->last_received_tick;
  line->last_received_tick = now;
  if (silence > app_board_ticks(firmware->board, XCP_LINE_SILENCE_MS)) {
    line->ignores_bytes = 0;
    line->in_count = 0;
  }
}

uint16_t xcp_line_take(xcp_line *line, const uint8_t *bytes, uint16_t count)
{
  uint16_t taken = 0;
  if ((count > 0U) && (line->out_count == 0U)) {
    reset_after_silence(line);
  }
  while ((taken < count) && (line->out_count == 0U)) {
    receive_byte(line, bytes[taken]);
    taken++;
  }
  return taken;
}

const uint8_t *xcp_line_offer(xcp_line *line, uint16_t *count)
{
  if (line->out_count == 0U) {
    wrap_packet(line, xcp_take(&line->slave, &line->out[XCP_LINE_HEADER_BYTES], XCP_PACKET));
  }
  *count = (uint16_t)(line->out_count - line->sent_count);
  return &line->out[line->sent_count];
}

void xcp_line_sent(xcp_line *line, uint16_t count)
{
  line->sent_count = (uint16_t)(line->sent_count + count);
  if (line->sent_count == line->out_count) {
    line->sent_count = 0;
    line->out_count = 0;
  }
}
