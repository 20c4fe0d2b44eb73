/* SPDX-License-Identifier: Apache-2.0 */
/* NOLINTBEGIN(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp): names that POSIX needs */
#define _XOPEN_SOURCE 700
// NOLINTEND(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp)
#include "xcp_port.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "xcp/line.h"

#define NO_NUMBER (-1)

static xcp_line line;
static int listener = NO_NUMBER;
static int master = NO_NUMBER;
static uint8_t in[256]; /* received bytes that are not processed yet */
static uint16_t in_count;
static uint16_t in_at;
static uint8_t out[16U * XCP_LINE_MAX_BYTES]; /* packets that the socket has not accepted yet */
static size_t out_count;
static size_t out_at;

void xcp_port_start(app *firmware, int listening)
{
  listener = listening;
  xcp_line_start(&line, firmware, 0);
}

static void close_connection(void)
{
  (void)close(master);
  master = NO_NUMBER;
  xcp_line_disconnect(&line);
}

static void accept_master(void)
{
  const int yes = 1;
  master = accept(listener, NULL, NULL);
  if (master == NO_NUMBER) {
    return;
  }
  (void)fcntl(master, F_SETFL, O_NONBLOCK);
  (void)setsockopt(master, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  in_count = 0;
  in_at = 0;
  out_count = 0;
  out_at = 0;
}

static int would_block(void) { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

static void send_pending_bytes(void)
{
  while (master != NO_NUMBER && out_at < out_count) {
    const ssize_t taken = write(master, out + out_at, out_count - out_at);
    if (taken < 0) {
      if (!would_block()) {
        close_connection();
      }
      return;
    }
    out_at += (size_t)taken;
  }
  out_count = 0;
  out_at = 0;
}

/* Collects packets while another packet fits. Returns whether it collected any. */
static int collect_packets(void)
{
  const size_t before = out_count;
  uint16_t count = 1;
  while (count > 0U && sizeof out - out_count >= XCP_LINE_MAX_BYTES) {
    const uint8_t *bytes = xcp_line_offer(&line, &count);
    memcpy(out + out_count, bytes, count);
    out_count += count;
    xcp_line_sent(&line, count);
  }
  return out_count > before;
}

static void receive_bytes(void)
{
  if (master == NO_NUMBER || in_at < in_count) {
    return;
  }
  const ssize_t count = read(master, in, sizeof in);
  in_at = 0;
  in_count = count > 0 ? (uint16_t)count : 0U;
  if (count == 0 || (count < 0 && !would_block())) {
    close_connection();
  }
}

/* Sends and processes bytes; closes a broken connection. Returns whether any byte was moved. */
static int transfer_bytes(void)
{
  send_pending_bytes();
  if (master == NO_NUMBER) {
    return 0;
  }
  const uint16_t taken = xcp_line_take(&line, in + in_at, (uint16_t)(in_count - in_at));
  in_at = (uint16_t)(in_at + taken);
  if (line.ignores_bytes != 0U) {
    close_connection();
    return 0;
  }
  const int has_packets = collect_packets();
  return taken > 0U || has_packets;
}

struct pollfd xcp_port_wanted(void)
{
  /* Do not wait for input while received bytes are unprocessed. */
  struct pollfd descriptor = {master != NO_NUMBER ? master : listener,
                              (short)(master == NO_NUMBER || in_at == in_count ? POLLIN : 0), 0};
  if (master != NO_NUMBER && out_count > 0U) {
    descriptor.events |= POLLOUT;
  }
  return descriptor;
}

void xcp_port_serve(void)
{
  if (listener == NO_NUMBER) {
    return;
  }
  if (master == NO_NUMBER) {
    accept_master();
  }
  receive_bytes();
  while (transfer_bytes()) {
  }
}

void xcp_port_tick(void)
{
  if (listener != NO_NUMBER) {
    xcp_line_tick(&line);
  }
}
