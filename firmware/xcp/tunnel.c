/* SPDX-License-Identifier: Apache-2.0 */
#include "xcp/tunnel.h"

/* Writes the length byte before a packet that is in place. Returns the new number of bytes. */
static uint16_t put_length(uint8_t *packets, uint16_t at, uint16_t length)
{
  uint16_t end = at;
  if (length > 0U) {
    packets[at] = (uint8_t)length;
    end = (uint16_t)(at + 1U + length);
  }
  return end;
}

uint16_t xcp_tunnel(xcp_slave *x, const uint8_t *command, uint16_t length, uint8_t *packets)
{
  const uint16_t size = LINK_MAX_PAYLOAD - 1U;
  uint16_t count = put_length(packets, 0, xcp_answer(x, command, length, &packets[1]));
  uint16_t last_count;
  do {
    last_count = count;
    if (count < size) {
      count =
          put_length(packets, count, xcp_take(x, &packets[count + 1U], (uint16_t)(size - count)));
    }
  } while (count > last_count);
  return count;
}
