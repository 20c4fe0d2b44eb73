/* SPDX-License-Identifier: Apache-2.0 */
/* Host board: the firmware as a process on a PC, with the source code of a real controller.

       firmware LINK PLANT [--xcp PORT]

   LINK: pty creates a pseudo-terminal and prints its name; a path opens a terminal; tcp:PORT
   listens. PLANT gives the ticks: fd:N is an inherited stream; tcp:PORT connects. --xcp listens for
   XCP on TCP. Port 0 selects a free port, which is printed. Ports are on 127.0.0.1. The process
   ends when the plant disconnects. */
/* NOLINTBEGIN(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp): names that POSIX needs */
#define _XOPEN_SOURCE 700
#define _DEFAULT_SOURCE  /* needed for cfmakeraw */
#define _DARWIN_C_SOURCE /* needed for cfmakeraw and INADDR_LOOPBACK on macOS */
// NOLINTEND(bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp)
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include "lockstep.h"
#include "xcp_port.h"

#ifndef B921600
#define B921600 921600 /* macOS defines no constants above 230400 and accepts any number */
#endif

#define BAD_USAGE 2
#define NO_NUMBER (-1)

static lockstep controller;
static int listener = NO_NUMBER; /* listening socket of a link on TCP */
static int link_fd = NO_NUMBER;
static int plant_fd = NO_NUMBER;
static int more_to_send; /* the link accepted fewer bytes than were offered */
static int more_to_read; /* the link has unread bytes */

static void exit_with_error(const char *subject, const char *reason)
{
  (void)fprintf(stderr, "firmware: %s: %s\n", subject, reason);
  exit(BAD_USAGE);
}

/* Returns the number after a prefix such as "tcp:", or NO_NUMBER. */
static int parse_number_after(const char *prefix, const char *text)
{
  const size_t length = strlen(prefix);
  if (strncmp(text, prefix, length) != 0) {
    return NO_NUMBER;
  }
  char *end = NULL;
  const long value = strtol(text + length, &end, 10);
  if (end == text + length || *end != '\0' || value < 0 || value > 65535) {
    exit_with_error(text, "not a number");
  }
  return (int)value;
}

static int new_socket(void)
{
  const int fd = socket(AF_INET, SOCK_STREAM, 0);
  if (fd < 0) {
    exit_with_error("socket", strerror(errno));
  }
  return fd;
}

static struct sockaddr_in local_address(int port)
{
  struct sockaddr_in address;
  memset(&address, 0, sizeof address);
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons((uint16_t)port);
  return address;
}

/* Sends small frames without delay, because the other side waits for each. */
static void disable_send_delay(int fd)
{
  const int yes = 1;
  (void)setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
}

/* Returns a listening socket and prints its port. */
static int open_listener(int port)
{
  struct sockaddr_in address = local_address(port);
  socklen_t size = sizeof address;
  const int fd = new_socket();
  const int yes = 1; /* allows to reuse the port of a process that was killed */
  if (setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
      bind(fd, (const struct sockaddr *)&address, size) != 0 || listen(fd, 1) != 0 ||
      getsockname(fd, (struct sockaddr *)&address, &size) != 0) {
    exit_with_error("port", strerror(errno));
  }
  (void)printf("%d\n", ntohs(address.sin_port));
  (void)fflush(stdout);
  return fd;
}

/* Opens a terminal in raw mode. */
static int open_terminal(const char *path)
{
  struct termios raw;
  const int fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);
  if (fd < 0 || tcgetattr(fd, &raw) != 0) {
    exit_with_error(path, strerror(errno));
  }
  cfmakeraw(&raw);
  (void)cfsetspeed(&raw, B921600);
  if (tcsetattr(fd, TCSANOW, &raw) != 0) {
    exit_with_error(path, strerror(errno));
  }
  return fd;
}

/* Opens a pseudo-terminal. Its other end stays open, so that a PC may connect and disconnect. */
static void open_pty(void)
{
  link_fd = posix_openpt(O_RDWR | O_NOCTTY);
  if (link_fd < 0 || grantpt(link_fd) != 0 || unlockpt(link_fd) != 0 ||
      fcntl(link_fd, F_SETFL, O_NONBLOCK) != 0) {
    exit_with_error("pty", strerror(errno));
  }
  (void)open_terminal(ptsname(link_fd));
  (void)printf("%s\n", ptsname(link_fd));
  (void)fflush(stdout);
}

static void open_link(const char *where)
{
  const int port = parse_number_after("tcp:", where);
  if (port != NO_NUMBER) {
    listener = open_listener(port);
  } else if (strcmp(where, "pty") == 0) {
    open_pty();
  } else {
    link_fd = open_terminal(where);
  }
}

static void open_plant(const char *where)
{
  const int port = parse_number_after("tcp:", where);
  if (port == NO_NUMBER) {
    plant_fd = parse_number_after("fd:", where);
    if (plant_fd == NO_NUMBER) {
      exit_with_error(where, "the plant is fd:N or tcp:PORT");
    }
    return;
  }
  const struct sockaddr_in address = local_address(port);
  plant_fd = new_socket();
  if (connect(plant_fd, (const struct sockaddr *)&address, sizeof address) != 0) {
    exit_with_error(where, strerror(errno));
  }
  disable_send_delay(plant_fd);
}

static void accept_link(void)
{
  link_fd = accept(listener, NULL, NULL);
  if (link_fd >= 0) {
    (void)fcntl(link_fd, F_SETFL, O_NONBLOCK);
    disable_send_delay(link_fd);
  }
}

/* Closes the link. On TCP another client may connect; a terminal stays silent. */
static void drop_link(void)
{
  (void)close(link_fd);
  link_fd = NO_NUMBER;
  more_to_send = 0;
}

static int would_block(void) { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

static uint16_t link_read(void *context, uint8_t *bytes, uint16_t size)
{
  (void)context;
  if (link_fd == NO_NUMBER || !more_to_read) {
    return 0;
  }
  more_to_read = 0; /* there is no input until poll reports some; this saves one call per tick */
  const ssize_t count = read(link_fd, bytes, size);
  if (count > 0) {
    return (uint16_t)count;
  }
  if (count == 0 || !would_block()) {
    drop_link();
  }
  return 0;
}

static uint16_t link_write(void *context, const uint8_t *bytes, uint16_t count)
{
  (void)context;
  if (link_fd == NO_NUMBER) {
    return count; /* the bytes are discarded */
  }
  const ssize_t taken = write(link_fd, bytes, count);
  if (taken < 0 && !would_block()) {
    drop_link();
    return count;
  }
  more_to_send = taken < (ssize_t)count;
  return taken > 0 ? (uint16_t)taken : 0;
}

static void answer_plant(const uint8_t *drive)
{
  size_t count = LINK_SIZE_PLANT_DRIVE;
  while (count > 0) {
    const ssize_t taken = write(plant_fd, drive, count);
    if (taken < 0 && errno == EINTR) {
      continue;
    }
    if (taken <= 0) {
      exit(EXIT_SUCCESS); /* the plant disconnected */
    }
    drive += taken;
    count -= (size_t)taken;
  }
}

static void receive_plant(void)
{
  uint8_t bytes[256];
  uint8_t drive[LINK_SIZE_PLANT_DRIVE];
  const ssize_t count = read(plant_fd, bytes, sizeof bytes);
  if (count == 0 || (count < 0 && !would_block())) {
    exit(EXIT_SUCCESS);
  }
  for (ssize_t i = 0; i < count; ++i) {
    if (lockstep_receive(&controller, bytes[i], drive)) {
      answer_plant(drive);
      xcp_port_tick();
    }
  }
}

/* Sleeps until link, XCP or plant has input, then processes it. */
static void wait_and_serve(void)
{
  struct pollfd descriptors[3];
  descriptors[0].fd = link_fd != NO_NUMBER ? link_fd : listener;
  descriptors[0].events = (short)(more_to_send ? POLLIN | POLLOUT : POLLIN);
  descriptors[1].fd = plant_fd;
  descriptors[1].events = POLLIN;
  descriptors[2] = xcp_port_wanted();
  if (poll(descriptors, 3, -1) < 0) {
    return;
  }
  if (link_fd == NO_NUMBER && listener != NO_NUMBER && (descriptors[0].revents & POLLIN) != 0) {
    accept_link();
  } else {
    more_to_read = descriptors[0].revents != 0;
  }
  if (descriptors[1].revents != 0) {
    receive_plant();
  }
  xcp_port_serve();
}

int main(int argc, char **argv)
{
  const int with_xcp = argc == 5 && strcmp(argv[3], "--xcp") == 0;
  if (argc != 3 && !with_xcp) {
    exit_with_error("usage", "firmware LINK PLANT [--xcp PORT]");
  }
  (void)signal(SIGPIPE, SIG_IGN); /* a failed write reports a disconnection */
  open_link(argv[1]);
  open_plant(argv[2]);
  lockstep_start(&controller, link_read, link_write);
  if (with_xcp) {
    const int fd = open_listener(parse_number_after("", argv[4]));
    if (fcntl(fd, F_SETFL, O_NONBLOCK) != 0) {
      exit_with_error("xcp", strerror(errno));
    }
    xcp_port_start(&controller.firmware, fd);
  }
  for (;;) {
    app_poll(&controller.firmware);
    wait_and_serve();
  }
}
