/* SPDX-License-Identifier: Apache-2.0 */
// NOLINTBEGIN(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp): how POSIX is asked for
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

#include "xcp/xcp.h"

#define NONE (-1)
#define HEAD 4U

static xcp_slave slave;
static int listener = NONE;
static int master = NONE;
static uint16_t counter;
static uint8_t in[HEAD + XCP_PACKET]; /* the command that arrives */
static size_t in_count;
static uint8_t out[16 * (HEAD + XCP_PACKET)]; /* packets that the socket has not taken yet */
static size_t out_count;
static size_t out_at;

void xcp_port_start(app *firmware, int listening)
{
  listener = listening;
  xcp_start(&slave, firmware);
}

static void hang_up(void)
{
  (void)close(master);
  master = NONE;
  xcp_hang_up(&slave);
}

static void accept_master(void)
{
  const int yes = 1;
  master = accept(listener, NULL, NULL);
  if (master == NONE) {
    return;
  }
  (void)fcntl(master, F_SETFL, O_NONBLOCK);
  (void)setsockopt(master, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  counter = 0;
  in_count = 0;
  out_count = 0;
  out_at = 0;
}

static int would_block(void) { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

/* Whether another packet fits. */
static int has_room(void) { return sizeof out - out_count >= HEAD + XCP_PACKET; }

/* Puts the head in front of a packet that stands behind it. */
static void put_packet(uint16_t length)
{
  if (length > 0U) {
    link_put_u16(out + out_count, length);
    link_put_u16(out + out_count + 2, counter++);
    out_count += HEAD + length;
  }
}

static void send_rest(void)
{
  while (master != NONE && out_at < out_count) {
    const ssize_t taken = write(master, out + out_at, out_count - out_at);
    if (taken < 0) {
      if (!would_block()) {
        hang_up();
      }
      return;
    }
    out_at += (size_t)taken;
  }
  out_count = 0;
  out_at = 0;
}

static void send_samples(void)
{
  uint16_t length = 1;
  while (master != NONE && length > 0U) {
    send_rest();
    if (out_count > 0U) {
      return; /* the socket is full */
    }
    while (length > 0U && has_room()) {
      length = xcp_take(&slave, out + out_count + HEAD);
      put_packet(length);
    }
  }
  send_rest();
}

/* Does the command once it is whole; the line is given up where its length cannot be. */
static void take_bytes(size_t count)
{
  in_count += count;
  if (in_count < HEAD) {
    return;
  }
  const uint16_t length = link_get_u16(in);
  if (length == 0U || length > XCP_PACKET) {
    hang_up();
  } else if (in_count == HEAD + length) {
    in_count = 0;
    put_packet(xcp_answer(&slave, in + HEAD, length, out + out_count + HEAD));
    send_rest();
  }
}

/* Reads as far as the head, then as far as the command: nothing of the next one. */
static size_t still_wanted(void)
{
  return in_count < HEAD ? HEAD - in_count : HEAD + link_get_u16(in) - in_count;
}

static void receive(void)
{
  while (master != NONE && has_room()) {
    const ssize_t count = read(master, in + in_count, still_wanted());
    if (count < 0 && would_block()) {
      return;
    }
    if (count <= 0) {
      hang_up();
    } else {
      take_bytes((size_t)count);
    }
  }
}

struct pollfd xcp_port_wanted(void)
{
  /* What is not read is not waited for either. */
  struct pollfd end = {master != NONE ? master : listener, (short)(has_room() ? POLLIN : 0), 0};
  if (out_count > 0U) {
    end.events |= POLLOUT;
  }
  return end;
}

void xcp_port_serve(void)
{
  if (listener == NONE) {
    return;
  }
  if (master == NONE) {
    accept_master();
  }
  receive();
  send_samples();
}

void xcp_port_tick(void)
{
  if (listener != NONE) {
    xcp_tick(&slave);
  }
}
