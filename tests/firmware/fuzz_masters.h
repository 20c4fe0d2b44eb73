/* SPDX-License-Identifier: Apache-2.0 */
/* The XCP masters of fuzz_firmware.c: on the slave itself, in frames of the link, and on a serial
   line. fuzz_firmware.c includes this file after the functions that the masters use. */
#ifndef ANHYST_FUZZ_MASTERS_H
#define ANHYST_FUZZ_MASTERS_H

/* Performs an XCP command, and checks what is true of every answer. */
static uint16_t perform_xcp_command(const uint8_t *command, uint16_t length, uint8_t *answer)
{
  const int listens = slave->is_connected != 0U || (length > 0U && command[0] == 0xFFU);
  const uint16_t count = xcp_answer(slave, command, length, answer);
  require(count <= XCP_PACKET && (count > 0U) == (listens && length > 0U));
  require(count == 0U || answer[0] == 0xFFU || answer[0] == 0xFEU);
  check_session();
  return count;
}

/* Sends the key, so that the protected commands are reached. */
static void unlock(void)
{
  uint8_t answer[XCP_PACKET];
  uint8_t command[6] = {0xF8, 0, 1};
  if (perform_xcp_command(command, 3, answer) == 6U) {
    const uint32_t key = link_crc32(XCP_SECRET, answer + 2, 4);
    command[0] = 0xF7;
    command[1] = 4;
    link_put_u32(command + 2, key);
    require(perform_xcp_command(command, 6, answer) == 2U && slave->is_unlocked != 0U);
  }
}

/* Allocates one list with one part and a few signals, which random commands would rarely do. */
static void allocate_list(script *s)
{
  static const uint8_t steps[][6] = {
      {0xD6}, {0xD5, 0, 1, 0}, {0xD4, 0, 0, 0, 1}, {0xD3, 0, 0, 0, 0, 3}, {0xE2, 0, 0, 0, 0, 0}};
  uint8_t answer[XCP_PACKET];
  for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
    (void)perform_xcp_command(steps[i], 6, answer);
  }
  for (int i = 0; i < 3; i++) {
    const uint8_t entry[8] = {0xE1, 0xFF, 4, 0, (uint8_t)(next8(s) & 0x3CU), 0, 1, 0};
    (void)perform_xcp_command(entry, 8, answer);
  }
}

/* Samples arrive complete and in the order of their ticks. */
static void take_samples(void)
{
  uint8_t packet[XCP_PACKET];
  uint16_t count = xcp_take(slave, packet, XCP_PACKET);
  for (; count > 0U; count = xcp_take(slave, packet, XCP_PACKET)) {
    require(count <= XCP_PACKET && locks == 0);
    require(packet[0] < XCP_ODTS || (packet[0] == 0xFDU && count == 2U));
    if (packet[0] == 0U && packet[1] == 0U && count >= 6U) {
      require(link_get_u32(packet + 2) - last_sample_tick <= sample.tick - last_sample_tick);
      last_sample_tick = link_get_u32(packet + 2);
    }
  }
}

/* Performs an XCP command, usually with its own length: codes from 0xC0 on, and valid areas. */
static void xcp_command(script *s)
{
  uint8_t command[XCP_PACKET + 4];
  uint8_t answer[XCP_PACKET];
  const uint8_t what = next8(s);
  uint16_t length = 8;
  switch (what & 0xC3U) {
  case 0x00:
    unlock();
    break;
  case 0x40:
    allocate_list(s);
    break;
  case 0x80:
    xcp_disconnect(slave);
    break;
  case 0xC0:
    command[0] = 0xF6; /* an address in a valid area, perhaps beyond its end */
    command[1] = 0;
    command[2] = 0;
    command[3] = 0;
    link_put_u16(command + 4, next16(s));
    link_put_u16(command + 6, (uint16_t)((what >> 2) & 7U));
    (void)perform_xcp_command(command, 8, answer);
    break;
  default:
    command[0] = (uint8_t)(0xC0U | (what >> 2));
    length = (what & 2U) != 0U ? (uint16_t)(next8(s) % sizeof command) : length;
    for (uint16_t i = 1; i < length; i++) {
      command[i] = (what & 1U) != 0U && i > 24U ? 0U : next8(s);
    }
    (void)perform_xcp_command(command, length, answer);
    break;
  }
  take_samples();
}

/* Sends a command in a frame of the link. */
static void carried_command(script *s)
{
  uint8_t payload[XCP_PACKET + 4];
  const uint8_t length = (uint8_t)(next8(s) & 15U);
  for (uint8_t i = 0; i < length; i++) {
    payload[i] = next8(s);
  }
  if (length > 0U) {
    payload[0] |= 0xC0U;
  }
  sequence++;
  put_frame(LINK_TYPE_XCP, payload, length, 0);
  poll();
}

/* Every packet that leaves the serial line is complete and has a correct checksum. */
static void check_sent_packets(uint16_t most)
{
  uint8_t packet[XCP_LINE_MAX_BYTES];
  uint16_t have = 0;
  uint16_t count = 0;
  const uint8_t *bytes = xcp_line_offer(&serial, &count);
  for (; count > 0U; bytes = xcp_line_offer(&serial, &count)) {
    const uint16_t part = count < most ? count : most;
    require(have + part <= sizeof packet);
    memcpy(packet + have, bytes, part);
    have = (uint16_t)(have + part);
    xcp_line_sent(&serial, part);
    if (part == count) {
      const uint16_t length = link_get_u16(packet);
      uint16_t sum = 0;
      require(have == 6U + length + length % 2U);
      for (uint16_t i = 0; i + 2U < have; i += 2U) {
        sum = (uint16_t)(sum + link_get_u16(packet + i));
      }
      require(sum == link_get_u16(packet + have - 2));
      have = 0;
    }
  }
}

/* Sends a command on the serial line, usually a complete one. */
static void serial_command(script *s)
{
  uint8_t bytes[XCP_LINE_MAX_BYTES] = {0};
  const uint8_t what = next8(s);
  uint16_t count = (uint16_t)((what & 15U) + 1U);
  uint16_t sum = 0;
  uint16_t at = 0;
  link_put_u16(bytes, count);
  for (uint16_t i = 0; i < count; i++) {
    bytes[4 + i] = next8(s);
  }
  bytes[4] |= 0xC0U;
  count = (uint16_t)(4U + count + count % 2U);
  for (uint16_t i = 0; i < count; i += 2U) {
    sum = (uint16_t)(sum + link_get_u16(bytes + i));
  }
  link_put_u16(bytes + count, sum);
  count = (uint16_t)(count + 2U - ((what & 0x20U) != 0U ? next8(s) % 4U : 0U));
  if ((what & 0x10U) != 0U) {
    bytes[next8(s) % count] ^= next8(s);
  }
  while (at < count) {
    at = (uint16_t)(at + xcp_line_take(&serial, bytes + at, (uint16_t)(count - at)));
    check_sent_packets((uint16_t)((what >> 6) + 1U));
  }
  check_session();
}

/* Runs one of the three XCP masters. */
static void any_command(script *s, uint8_t way)
{
  if (way == 0U) {
    carried_command(s);
  } else if (way == 1U) {
    serial_command(s);
  } else {
    xcp_command(s);
  }
}

#endif
