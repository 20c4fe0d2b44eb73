/* An XCP slave for tests, written from ASAM MCD-1 XCP 1.1; it shares no source with anhyst.

   Usage: slave [name=value ...], with the names of `options` in memory.c. The slave prints the
   address of each of its variables, then its port, and serves one master after the other on
   127.0.0.1. With tty=NUMBER, it uses an open file, the end of a serial port, with
   HEADER_LEN_CTR_WORD and CHECKSUM_WORD instead. */

#include "slave.h"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static int line, is_serial;
static uint16_t counter;
static unsigned long answers, sample_packets, commands;

static void send_bytes(const uint8_t *packet, unsigned size)
{
  uint8_t frame[4 + 65536 + 3];
  unsigned length = 4 + size;
  frame[0] =
      (uint8_t)size; /* the head has the low byte first, whatever the order of the slave is */
  frame[1] = (uint8_t)(size >> 8);
  frame[2] = (uint8_t)counter;
  frame[3] = (uint8_t)(counter >> 8);
  counter++;
  memcpy(frame + 4, packet, size);
  if (is_serial) {
    unsigned sum = 0;
    if (length % 2) {
      frame[length++] = 0;
    }
    for (unsigned n = 0; n < length; n += 2) {
      sum += frame[n] | frame[n + 1] << 8;
    }
    frame[length++] = (uint8_t)sum;
    frame[length++] = (uint8_t)(sum >> 8);
  }
  for (unsigned sent = 0; sent < length;) {
    ssize_t count = write(line, frame + sent, length - sent);
    if (count <= 0) {
      return;
    }
    sent += (unsigned)count;
  }
}

static void answer(const uint8_t *packet, unsigned size)
{
  answers++;
  if (option("lose_answer") && answers % option("lose_answer") == 0) {
    return;
  }
  send_bytes(packet, size);
}

static void refuse(uint8_t code)
{
  uint8_t packet[2] = {0xFE, code};
  if (code == 0x00) {
    send_bytes(packet, 2);
  } else {
    answer(packet, 2);
  }
}

static void confirm(void) { answer((uint8_t[1]){0xFF}, 1); }

/* DAQ lists. */

enum { LISTS = 3, ODTS = 64, ENTRIES = 32, EVENTS = 3 };
struct list {
  unsigned odts, entries[ODTS];
  struct {
    uint8_t size, extension;
    uint64_t address;
  } entry[ODTS][ENTRIES];
  unsigned event, prescaler, passed;
  int running, selected, has_stamp;
};
static struct list lists[LISTS];
static unsigned pointer_list, pointer_odt, pointer_entry, list_count;
static const unsigned event_periods[EVENTS] = {1, 10, 0};
static const char *const event_names[EVENTS] = {"fast", "slow", "never"};

static unsigned static_odts(unsigned list) { return list == 1 ? 2 : 6; }

static unsigned static_entries(unsigned list) { return list == 1 ? 3 : 7; }

static unsigned first_identifier(unsigned list)
{
  unsigned first = 0;
  for (unsigned n = 0; n < list; n++) {
    first += option("daq") == 1 ? static_odts(n) : lists[n].odts;
  }
  return first;
}

static void send_odt(unsigned number, unsigned odt, uint32_t stamp)
{
  struct list *list = &lists[number];
  uint8_t packet[65536];
  unsigned size = (unsigned)option("identifier");
  packet[0] = (uint8_t)(size == 1 ? first_identifier(number) + odt : odt);
  packet[1] = 0xAA;
  if (size == 2) {
    packet[1] = (uint8_t)number;
  } else if (size > 2) {
    put16(packet + size - 2, number);
  }
  if (odt == 0 && list->has_stamp) {
    long bytes = option("stamp");
    if (bytes == 4) {
      put32(packet + size, stamp);
    } else if (bytes == 2) {
      put16(packet + size, stamp & 0xFFFF);
    } else if (bytes == 1) {
      packet[size] = (uint8_t)stamp;
    }
    size += (unsigned)bytes;
  }
  for (unsigned n = 0; n < list->entries[odt]; n++) {
    if (!read_memory(packet + size, list->entry[odt][n].extension, list->entry[odt][n].address,
                     list->entry[odt][n].size)) {
      return;
    }
    size += list->entry[odt][n].size;
  }
  if (size > (unsigned)option("dto")) {
    fprintf(stderr, "a sample of %u bytes is longer than MAX_DTO\n", size);
    exit(1);
  }
  sample_packets++;
  if (option("lose_sample") && sample_packets % option("lose_sample") == 0) {
    return;
  }
  if (option("overload_bit") && sample_packets % 100 == 0) {
    packet[0] |= 0x80;
  }
  send_bytes(packet, size - (option("cut_sample") ? 1 : 0));
}

static void happen(unsigned event, uint32_t stamp)
{
  for (unsigned n = 0; n < LISTS; n++) {
    if (!lists[n].running || lists[n].event != event || ++lists[n].passed < lists[n].prescaler) {
      continue;
    }
    lists[n].passed = 0;
    for (unsigned odt = 0; odt < lists[n].odts; odt++) {
      if (lists[n].entries[odt]) {
        send_odt(n, odt, stamp);
      }
    }
  }
}

/* The bytes for values in an ODT; the time stamp counts once the mode of the list is known. */
static unsigned usable_bytes(const struct list *list, unsigned odt)
{
  int has_stamp = list->has_stamp || option("stamp_fixed");
  return (unsigned)(option("dto") - option("identifier") -
                    (odt == 0 && has_stamp ? option("stamp") : 0));
}

static int fits(const struct list *list)
{
  for (unsigned odt = 0; odt < list->odts; odt++) {
    unsigned used = 0;
    for (unsigned n = 0; n < list->entries[odt]; n++) {
      used += list->entry[odt][n].size;
    }
    if (used > usable_bytes(list, odt)) {
      return 0;
    }
  }
  return 1;
}

static uint8_t write_entry(unsigned size, unsigned extension, uint64_t address)
{
  struct list *list = &lists[pointer_list];
  uint8_t present[8];
  unsigned used = 0,
           limit = option("daq") == 1 ? static_entries(pointer_list) : list->entries[pointer_odt];
  if (pointer_odt >= list->odts || pointer_entry >= limit || pointer_entry >= ENTRIES) {
    return 0x22;
  }
  if (size == 0 || size > (unsigned)option("max_entry") || size % option("entry_granularity") ||
      address % option("entry_granularity")) {
    return 0x22;
  }
  if (!read_memory(present, extension, address, size)) {
    return 0x24;
  }
  for (unsigned n = 0; n < pointer_entry; n++) {
    used += list->entry[pointer_odt][n].size;
    if (option("one_extension") && list->entry[pointer_odt][n].extension != extension) {
      return 0x2A;
    }
  }
  if (used + size > usable_bytes(list, pointer_odt)) {
    return 0x2A;
  }
  list->entry[pointer_odt][pointer_entry].size = (uint8_t)size;
  list->entry[pointer_odt][pointer_entry].extension = (uint8_t)extension;
  list->entry[pointer_odt][pointer_entry].address = address;
  pointer_entry++;
  if (option("daq") == 1) {
    list->entries[pointer_odt] = pointer_entry;
  }
  return 0;
}

static void stop_all(void)
{
  for (unsigned n = 0; n < LISTS; n++) {
    lists[n].running = lists[n].selected = 0;
  }
}

static uint8_t daq_command(const uint8_t *c, unsigned size)
{
  unsigned number = size >= 4 ? get16(c + 2) : 0;
  int is_dynamic = option("daq") == 2, first = is_dynamic ? 0 : 1;
  uint8_t a[8] = {0xFF};
  if (c[0] >= 0xD3 && c[0] <= 0xD6 && !is_dynamic) {
    return 0x20;
  }
  switch (c[0]) {
  case 0xDA: /* GET_DAQ_PROCESSOR_INFO */
    a[1] = (uint8_t)(is_dynamic | 0x02 | (option("stamp") ? 0x10 : 0) |
                     (option("overload_bit") ? 0x40 : 0));
    put16(a + 2, LISTS);
    put16(a + 4, EVENTS);
    a[6] = (uint8_t)first;
    a[7] = (uint8_t)((option("identifier") - 1) << 6 | (option("one_extension") ? 0x10 : 0));
    answer(a, 8);
    return 0xFF;
  case 0xD9: /* GET_DAQ_RESOLUTION_INFO */
    a[1] = (uint8_t)option("entry_granularity");
    a[2] = (uint8_t)option("max_entry");
    a[3] = 1;
    a[5] = (uint8_t)(option("stamp") | (option("stamp_fixed") ? 0x08 : 0) | 0x50); /* unit 100 us */
    if (option("stamp") > 1) {
      a[5] = (uint8_t)((a[5] & 0x0F) | 0x30); /* unit 1 us */
    }
    put16(a + 6, 1);
    answer(a, 8);
    return 0xFF;
  case 0xD8: /* GET_DAQ_LIST_INFO */
    if (is_dynamic || number >= LISTS) {
      return is_dynamic ? 0x20 : 0x22;
    }
    a[1] = (uint8_t)(number == 0 ? 0x05 : number == 1 ? 0x06 : 0x04);
    a[2] = (uint8_t)static_odts(number);
    a[3] = (uint8_t)static_entries(number);
    put16(a + 4, 0);
    answer(a, 6);
    return 0xFF;
  case 0xD6: /* FREE_DAQ */
    memset(lists, 0, sizeof(lists));
    list_count = 0;
    break;
  case 0xD5: /* ALLOC_DAQ */
    if (get16(c + 2) > LISTS) {
      return 0x30;
    }
    list_count = get16(c + 2);
    break;
  case 0xD4: /* ALLOC_ODT */
    if (number >= list_count || c[4] > ODTS) {
      return number >= list_count ? 0x22 : 0x30;
    }
    lists[number].odts = c[4];
    break;
  case 0xD3: /* ALLOC_ODT_ENTRY */
    if (number >= list_count || c[4] >= lists[number].odts || c[5] > ENTRIES) {
      return c[5] > ENTRIES ? 0x30 : 0x22;
    }
    lists[number].entries[c[4]] = c[5];
    break;
  case 0xE3: /* CLEAR_DAQ_LIST */
    if (number >= LISTS || (!is_dynamic && number == 0)) {
      return number == 0 ? 0x24 : 0x22;
    }
    memset(&lists[number], 0, sizeof(lists[number]));
    lists[number].odts = static_odts(number);
    break;
  case 0xE2: /* SET_DAQ_PTR */
    if (number >= LISTS || c[4] >= lists[number].odts) {
      return 0x22;
    }
    pointer_list = number;
    pointer_odt = c[4];
    pointer_entry = c[5];
    break;
  case 0xE1: { /* WRITE_DAQ */
    uint8_t code = write_entry(c[2] * (unsigned)option("granularity"), c[3],
                               (uint64_t)get32(c + 4) * (uint64_t)option("granularity"));
    if (code) {
      return code;
    }
    break;
  }
  case 0xE0: /* SET_DAQ_LIST_MODE */
    if (number >= LISTS || get16(c + 4) >= EVENTS || c[6] == 0) {
      return 0x22;
    }
    if (!is_dynamic && number == 1 && get16(c + 4) != 0) {
      return 0x27;
    }
    lists[number].has_stamp = (c[1] & 0x10) != 0 || option("stamp_fixed");
    lists[number].event = get16(c + 4);
    lists[number].prescaler = c[6];
    break;
  case 0xDE: /* START_STOP_DAQ_LIST */
    if (number >= LISTS || !fits(&lists[number])) {
      return number >= LISTS ? 0x22 : 0x2A;
    }
    lists[number].running = c[1] == 1;
    lists[number].selected = c[1] == 2;
    a[1] = (uint8_t)first_identifier(number);
    answer(a, 2);
    return 0xFF;
  case 0xDD: /* START_STOP_SYNCH */
    for (unsigned n = 0; n < LISTS; n++) {
      lists[n].running = c[1] == 1 && lists[n].selected ? 1 : c[1] == 1 ? lists[n].running : 0;
    }
    break;
  default:
    return 0x20;
  }
  confirm();
  return 0xFF;
}

/* Commands. */

static uint64_t mta;
static unsigned mta_extension;
static const uint8_t *mta_text;
static uint8_t seed[4] = {0x12, 0x34, 0x56, 0x78};
static unsigned unlocked;

static unsigned locked(void) { return (unsigned)option("locked") & ~unlocked; }

static uint8_t upload(unsigned count, unsigned extension, uint64_t address)
{
  uint8_t packet[256] = {0xFF};
  unsigned granularity = (unsigned)option("granularity"), size = count * granularity;
  if (size + granularity > (unsigned)option("cto")) {
    return 0x22;
  }
  if (mta_text != NULL) {
    memcpy(packet + granularity, mta_text, size);
    mta_text += size;
  } else if (!read_memory(packet + granularity, extension, address, size)) {
    return 0x24;
  }
  answer(packet, granularity + size - (option("cut_answer") ? 1 : 0));
  return 0xFF;
}

static uint8_t download(const uint8_t *data, unsigned count, unsigned extension, uint64_t address)
{
  if (locked() & 0x01) {
    return 0x25;
  }
  if (extension == 0 && address == (uint64_t)(uintptr_t)&par_fixed) {
    return 0x23;
  }
  if (!write_memory(data, extension, address, count * (unsigned)option("granularity"))) {
    return 0x24;
  }
  if (option("pending")) {
    for (int n = 0; n < 3; n++) {
      send_bytes((uint8_t[2]){0xFD, 0x05}, 2);
      usleep(500000);
    }
  }
  confirm();
  return 0xFF;
}

static uint8_t execute(const uint8_t *c, unsigned size)
{
  uint64_t granularity = (uint64_t)option("granularity");
  uint8_t a[8] = {0xFF};
  switch (c[0]) {
  case 0xFF: /* CONNECT */
    unlocked = 0;
    stop_all();
    a[1] = (uint8_t)(0x01 | (option("daq") ? 0x04 : 0));
    a[2] = (uint8_t)((option("big") ? 1 : 0) | (granularity == 2 ? 2 : granularity == 4 ? 4 : 0));
    a[3] = (uint8_t)option("cto");
    put16(a + 4, (unsigned)option("dto"));
    a[6] = a[7] = 1;
    answer(a, 8);
    return 0xFF;
  case 0xFE: /* DISCONNECT */
    stop_all();
    break;
  case 0xFD: /* GET_STATUS */
    a[2] = (uint8_t)locked();
    answer(a, 6);
    return 0xFF;
  case 0xFC: /* SYNCH */
    return 0x00;
  case 0xF8: /* GET_SEED */
    a[1] = (uint8_t)((locked() & c[2]) ? 4 : 0);
    memcpy(a + 2, seed, 4);
    answer(a, 6);
    return 0xFF;
  case 0xF7: /* UNLOCK: the key is the seed with all bits inverted */
    for (unsigned n = 0; n < 4; n++) {
      if (c[1] != 4 || (c[2 + n] ^ seed[n]) != 0xFF) {
        return 0x25;
      }
    }
    unlocked = 0xFF;
    a[1] = 0;
    answer(a, 2);
    return 0xFF;
  case 0xF6: /* SET_MTA */
    mta = get32(c + 4) * granularity;
    mta_extension = c[3];
    mta_text = NULL;
    break;
  case 0xF5: { /* UPLOAD */
    uint8_t code = upload(c[1], mta_extension, mta);
    mta += c[1] * granularity;
    return code;
  }
  case 0xF4: /* SHORT_UPLOAD */
    mta_text = NULL;
    return option("short_upload") ? upload(c[1], c[3], get32(c + 4) * granularity) : 0x20;
  case 0xF0: { /* DOWNLOAD */
    uint8_t code = download(c + (granularity == 4 ? 4 : 2), c[1], mta_extension, mta);
    mta += c[1] * granularity;
    return code;
  }
  case 0xED: /* SHORT_DOWNLOAD */
    return option("short_download") ? download(c + 8, c[1], c[3], get32(c + 4) * granularity)
                                    : 0x20;
  case 0xD7: { /* GET_DAQ_EVENT_INFO */
    unsigned event = get16(c + 2), scale = event_periods[event < EVENTS ? event : 0];
    long period = option("stated_us") ? option("stated_us") : option("period_us");
    if (!option("event_info") || !option("daq")) {
      return 0x20;
    }
    if (event >= EVENTS) {
      return 0x22;
    }
    a[1] = 0x04;
    a[2] = LISTS;
    a[3] = (uint8_t)strlen(event_names[event]);
    a[4] = (uint8_t)(period * scale / 100);
    a[5] = 5; /* unit 100 us */
    mta_text = (const uint8_t *)event_names[event];
    answer(a, 7);
    return 0xFF;
  }
  default:
    if (!option("daq")) {
      return 0x20;
    }
    if (locked() & 0x04 && c[0] < 0xE4 && c[0] != 0xDA && c[0] != 0xD9) {
      return 0x25;
    }
    return daq_command(c, size);
  }
  confirm();
  return 0xFF;
}

static void receive(const uint8_t *packet, unsigned size)
{
  uint8_t padded[65536] = {0};
  static int was_busy;
  commands++;
  if (option("busy") && commands % option("busy") == 0 && !was_busy) {
    was_busy = 1;
    refuse(0x10);
    return;
  }
  was_busy = 0;
  memcpy(padded, packet, size);
  uint8_t code = execute(padded, size);
  if (code != 0xFF) {
    refuse(code);
  }
}

static double now(void)
{
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* Serves a master until it leaves. Events happen at their times, and late ones immediately. */
static void serve(void)
{
  static uint8_t buffer[1 << 17];
  unsigned filled = 0;
  double period = 1e-6 * (double)option("period_us"), begin = now();
  uint32_t t = 0;
  counter = 0;
  stop_all();
  for (;;) {
    struct pollfd ready = {line, POLLIN, 0};
    int wait_ms = (int)(1e3 * (begin + (t + 1) * period - now()));
    if (poll(&ready, 1, wait_ms < 0 ? 0 : wait_ms) > 0) {
      ssize_t count = read(line, buffer + filled, sizeof(buffer) - filled);
      if (count <= 0) {
        return;
      }
      filled += (unsigned)count;
      while (filled >= 4) {
        unsigned size = buffer[0] | buffer[1] << 8;
        unsigned whole = 4 + size + (is_serial ? size % 2 + 2 : 0);
        if (filled < whole) {
          break;
        }
        receive(buffer + 4, size);
        filled -= whole;
        memmove(buffer, buffer + whole, filled);
      }
    }
    while (now() >= begin + (t + 1) * period) {
      uint32_t stamp = (uint32_t)(++t * (uint64_t)option("period_us"));
      stamp += option("jitter_us") ? (uint32_t)((t * 7919u) % (unsigned)option("jitter_us")) : 0;
      stamp = option("stamp") == 1 ? stamp / 100 : stamp;
      update(t);
      happen(0, stamp);
      if (t % 10 == 0) {
        happen(1, stamp);
      }
    }
  }
}

int main(int argc, char **argv)
{
  const char *tty = NULL;
  for (int n = 1; n < argc; n++) {
    char *value = strchr(argv[n], '=');
    *value++ = '\0';
    if (strcmp(argv[n], "tty") == 0) {
      tty = value;
      continue;
    }
    option(argv[n]);
    for (unsigned k = 0; k < option_count; k++) {
      options[k].value = strcmp(options[k].name, argv[n]) ? options[k].value : atol(value);
    }
  }
  for (unsigned n = 0; n < variable_count; n++) {
    printf("%s %lu\n", variables[n].name,
           (unsigned long)((uintptr_t)variables[n].place / (unsigned)option("granularity")));
  }
  if (tty != NULL) {
    is_serial = 1;
    line = atoi(tty);
    printf("port 0\n");
    fflush(stdout);
    serve();
    return 0;
  }
  int listener = socket(AF_INET, SOCK_STREAM, 0);
  struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  socklen_t length = sizeof(address);
  if (bind(listener, (struct sockaddr *)&address, sizeof(address)) || listen(listener, 1)) {
    return 1;
  }
  getsockname(listener, (struct sockaddr *)&address, &length);
  printf("port %d\n", ntohs(address.sin_port));
  fflush(stdout);
  for (;;) {
    line = accept(listener, NULL, NULL);
    setsockopt(line, IPPROTO_TCP, TCP_NODELAY, &(int){1}, sizeof(int));
    serve();
    close(line);
  }
}
