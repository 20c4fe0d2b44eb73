/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzzing harness. An input is a script of possible actions of a line, a PC, an XCP master and
   sensors.

   Parser, request handler, XCP slave and control task run with a compiled compensator. Address and
   undefined-behaviour sanitizers check the memory; `require` checks what must always be true. With
   FUZZ_XCP, a script contains actions of an XCP master, with a few ticks in between. */
#include "boards/actuator.h"
#include "app/app.h"
#include "force/force.h"
#include "link/crc.h"
#include "xcp/line.h"

#include <stdlib.h>
#include <string.h>

#define MAX_SCRIPT_STEPS 32

typedef struct {
  const uint8_t *data;
  size_t size;
  size_t at;
} script;

static const app_limits limits = {
    .gap = {-PORT_ONE / 8, PORT_ONE / 8 * 9, PORT_ONE / 50, 12},
    .force = {-PORT_ONE / 4, PORT_ONE / 4 * 5, PORT_ONE / 5, 14},
    .current = {-PORT_ONE, PORT_ONE, PORT_ONE / 5, 16},
    .current_low = INT32_MIN / 8 * 7,
    .current_high = INT32_MAX / 8 * 7,
    .stuck_current = INT32_MAX / 50,
    .max_implausible_samples = 2,
    .missed_ticks = 3,
    .selftest_ticks = 4,
    .ramp_ms = 50,
    .heartbeat_ms = 500,
    .has_current_sensor = 1,
};

static app_body body;

static const int16_t scales[ANHYST_SCALE_WORDS] = ACTUATOR_SCALES;

static const app_board board = {
    .name = ACTUATOR_CALLED,
    .kernel = &ACTUATOR_KERNEL,
    .words = ACTUATOR_PARAMETERS,
    .words_capacity = ACTUATOR_PARAMETERS_WORDS,
    .scales = scales,
    .firmware = 1,
    .rate = ACTUATOR_RATE_HZ,
    .limits = &limits,
};

static app fresh; /* state after app_start, whose check of the block would take most of the time */
static app_body fresh_body;
static app firmware;
static port_sample sample;
static int32_t drive;
static uint32_t drive_state;
static uint8_t wire[4096];
static uint16_t wire_count;
static uint16_t wire_index;
static uint16_t max_accepted_bytes;
static link_receiver line; /* receiver of a PC */
static link_receiver twin; /* receiver that the firmware should be equal to */
static uint32_t answers;
static uint32_t requests;
static uint8_t sequence;
static int locks;
static xcp_slave *const slave = &firmware.carried; /* used directly and through the link */
static xcp_line serial;                            /* with checksums and its own slave */
static uint32_t last_sample_tick;                  /* tick of the last sample of list 0 */

static void require(int holds)
{
  if (!holds) {
    abort();
  }
}

static uint8_t next8(script *s) { return s->at < s->size ? s->data[s->at++] : 0; }

static uint16_t next16(script *s)
{
  const uint16_t low = next8(s);
  return (uint16_t)(low | ((uint16_t)next8(s) << 8));
}

static int32_t next32(script *s)
{
  uint8_t bytes[4];
  for (int i = 0; i < 4; i++) {
    bytes[i] = next8(s);
  }
  return link_get_i32(bytes);
}

static void sense(void *context, port_sample *to)
{
  (void)context;
  *to = sample;
}

static void put_drive(void *context, const int32_t *currents, uint32_t state)
{
  (void)context;
  drive = currents[0];
  drive_state = state;
}

static uint16_t link_read(void *context, uint8_t *bytes, uint16_t most)
{
  (void)context;
  uint16_t count = 0;
  while (count < most && wire_index < wire_count) {
    bytes[count++] = wire[wire_index++];
  }
  return count;
}

/* XCP packets follow each other without gaps, and each has its stated length. */
static void check_packets(const link_frame *answer)
{
  uint16_t at = 0;
  while (at < answer->length) {
    require(answer->payload[at] > 0U && answer->payload[at] <= XCP_PACKET);
    at = (uint16_t)(at + 1U + answer->payload[at]);
  }
  require(at == answer->length);
}

static uint16_t link_write(void *context, const uint8_t *bytes, uint16_t count)
{
  (void)context;
  const uint16_t taken = count < max_accepted_bytes ? count : max_accepted_bytes;
  link_frame answer;
  for (uint16_t i = 0; i < taken; i++) {
    if (link_receive(&line, bytes[i], &answer)) {
      answers++;
      require(answer.type >= 0x80U && answer.version == LINK_VERSION);
      if (answer.type == LINK_TYPE_XCP_PACKETS) {
        check_packets(&answer);
      }
    }
  }
  return taken;
}

static void lock_tick(void *context)
{
  (void)context;
  locks++;
}

static void unlock_tick(void *context)
{
  (void)context;
  locks--;
}

static int keep(void *context, const int16_t *block, uint16_t words)
{
  (void)context;
  require(block[ANHYST_WORD_LENGTH] == (int16_t)words);
  return words % 2U == 0U;
}

static const struct port port = {.sense = sense,
                                 .drive = put_drive,
                                 .link_read = link_read,
                                 .link_write = link_write,
                                 .lock = lock_tick,
                                 .unlock = unlock_tick,
                                 .keep = keep};

static void put_byte(uint8_t byte)
{
  link_frame frame;
  if (wire_count < sizeof wire) {
    wire[wire_count++] = byte;
    requests += (uint32_t)link_receive(&twin, byte, &frame);
  }
}

/* Checks what must be true after any input. */
static void check_session(void)
{
  const int16_t *words = firmware.control.body->compensator.words;
  require(locks == 0);
  require(answers == requests && line.discarded_frames == 0 &&
          firmware.session.receiver.discarded_frames == twin.discarded_frames);
  require(words == ACTUATOR_PARAMETERS || words == firmware.download.words[0] ||
          words == firmware.download.words[1]);
  for (uint16_t i = 0; i < (uint16_t)LINK_SETTING_COUNT; i++) {
    require(app_setting_refusal(&board, i, firmware.settings[i], 0) == LINK_REASON_NONE);
  }
}

static void poll(void)
{
  const app_session *session = &firmware.session;
  do {
    app_poll(&firmware);
  } while (wire_index < wire_count || session->unsent_count > 0U ||
           session->chunk_index < session->chunk_count);
  wire_index = 0;
  wire_count = 0;
  check_session();
}

static int32_t magnitude(int32_t value) { return value < 0 ? -(value + 1) : value; }

static void tick(void)
{
  const app_control *control = &firmware.control;
  const anhyst_supervisor *states = app_body_states(control->body);
  const int32_t before = drive;
  const int was_live = states->state == ANHYST_STATE_RUN || states->conditioning != 0U;
  app_tick(&firmware);
  xcp_line_tick(&serial);
  require(drive >= limits.current_low && drive <= limits.current_high);
  require(states->state <= ANHYST_STATE_FAULT && states->fault < ANHYST_FAULT_COUNT);
  require((states->state == ANHYST_STATE_FAULT) == (states->fault != ANHYST_FAULT_NONE));
  require(drive_state == states->state + 256U * states->fault);
  require(control->tick == sample.tick);
  if (states->state == ANHYST_STATE_FAULT || !was_live) {
    /* in the safe state, the current moves towards zero by at least one step of the ramp */
    const int32_t size = magnitude(before);
    require(magnitude(drive) <=
            (size > control->body->ramp_step ? size - control->body->ramp_step + 1 : 0));
  }
}

static void put_frame(uint8_t type, const uint8_t *payload, uint8_t length, uint8_t damage)
{
  uint8_t bytes[LINK_MAX_ENCODED_FRAME];
  const link_frame frame = {LINK_VERSION, type, sequence, length, 0, payload, 0};
  const uint16_t count = link_encode(bytes, &frame);
  if (damage != 0U) {
    bytes[damage % count] ^= (uint8_t)(1U << (damage & 7U));
  }
  for (uint16_t i = 0; i < count; i++) {
    put_byte(bytes[i]);
  }
}

static void send_words(const uint8_t *words, uint16_t count)
{
  uint8_t payload[LINK_MAX_PAYLOAD];
  for (uint16_t at = 0; at < count; at = (uint16_t)(at + 100U)) {
    const uint16_t part = (uint16_t)(count - at < 100 ? count - at : 100);
    link_put_u16(payload, at);
    memcpy(payload + 2, words + 2U * at, 2U * part);
    sequence++;
    put_frame(LINK_TYPE_BLOCK_DATA, payload, (uint8_t)(2U + 2U * part), 0);
    poll();
  }
}

/* Sends a complete block: the built-in block with a few changed words and a correct checksum, so
   that the later checks are reached. */
static void download(script *s)
{
  static uint8_t words[2 * ACTUATOR_PARAMETERS_WORDS];
  uint8_t payload[LINK_SIZE_BLOCK_BEGIN];
  for (size_t i = 0; i < ACTUATOR_PARAMETERS_WORDS; i++) {
    link_put_u16(words + 2 * i, (uint16_t)ACTUATOR_PARAMETERS[i]);
  }
  for (int changes = next8(s) & 3; changes > 0; changes--) {
    const size_t at = next16(s) % ACTUATOR_PARAMETERS_WORDS;
    link_put_u16(words + 2 * at, next16(s));
  }
  const uint32_t head = link_crc32(0, words, 2 * ANHYST_WORD_CRC);
  const uint32_t own = link_crc32(head, words + 2 * (ANHYST_WORD_CRC + 2),
                                  2 * (ACTUATOR_PARAMETERS_WORDS - ANHYST_WORD_CRC - 2));
  link_put_u32(words + 2 * ANHYST_WORD_CRC, own);
  link_put_u16(payload, ACTUATOR_PARAMETERS_WORDS);
  memcpy(payload + 2, words + 2 * ANHYST_WORD_GENERATION, 2);
  link_put_u32(payload + 4, link_crc32(0, words, sizeof words));
  sequence++;
  put_frame(LINK_TYPE_BLOCK_BEGIN, payload, LINK_SIZE_BLOCK_BEGIN, 0);
  send_words(words, ACTUATOR_PARAMETERS_WORDS);
  sequence++;
  put_frame(LINK_TYPE_BLOCK_SWAP, words + 2 * ANHYST_WORD_GENERATION, LINK_SIZE_BLOCK_SWAP, 0);
  poll();
}

/* Sends a request, usually with the length of its type. */
static void request(script *s, uint8_t damage)
{
  static const uint8_t lengths[16] = {
      0,
      LINK_SIZE_HELLO,
      LINK_SIZE_HEARTBEAT,
      LINK_SIZE_DEMAND,
      LINK_SIZE_COMMAND,
      LINK_SIZE_SETTING_READ,
      LINK_SIZE_SETTING_WRITE,
      LINK_SIZE_BLOCK_BEGIN,
      LINK_SIZE_BLOCK_DATA + 8,
      LINK_SIZE_BLOCK_SWAP,
      LINK_SIZE_BLOCK_READ,
  };
  uint8_t payload[LINK_MAX_PAYLOAD];
  const uint8_t type = next8(s);
  uint8_t length = lengths[type & 15U];
  if ((type & 0x40U) != 0U) {
    length = (uint8_t)(next8(s) % (LINK_MAX_PAYLOAD + 1));
  }
  for (uint8_t i = 0; i < length; i++) {
    payload[i] = next8(s);
  }
  if ((type & 0x1FU) == (0x10U | LINK_TYPE_HELLO) && length == LINK_SIZE_HELLO) {
    link_put_u16(payload, LINK_VERSION);
  }
  sequence = (type & 0x20U) != 0U ? next8(s) : (uint8_t)(sequence + 1U);
  put_frame(type & 0x8FU, payload, length, damage);
  poll();
}

static void command(script *s)
{
  uint8_t payload[LINK_SIZE_COMMAND];
  link_put_u16(payload, next8(s) & 7U);
  sequence++;
  put_frame(LINK_TYPE_COMMAND, payload, sizeof payload, 0);
  poll();
}

static void quiet_ticks(script *s)
{
  for (int count = next8(s) & 15; count >= 0; count--) {
    sample.tick++;
    sample.gap ^= 64;
    sample.force ^= 64;
    sample.current[0] ^= 64;
    tick();
  }
}

static void any_sample(script *s)
{
  const uint8_t kind = next8(s);
  sample.tick += (kind & 1U) != 0U ? next8(s) : 1U;
  sample.gap = (kind & 2U) != 0U ? next32(s) : (int32_t)next16(s) * 0x4000;
  if ((kind & 4U) != 0U) {
    sample.force = next32(s);
  }
  if ((kind & 8U) != 0U) {
    sample.current[0] = next32(s);
  }
  sample.status = (kind & 16U) != 0U ? next8(s) : 0U;
  tick();
}

static void raw_bytes(script *s)
{
  for (int count = next8(s) & 63; count >= 0; count--) {
    put_byte(next8(s));
  }
  poll();
}

#include "fuzz_masters.h"

static void step(script *s)
{
  const uint8_t what = next8(s);
  max_accepted_bytes = (uint16_t)((what >> 3) + 1U);
#ifdef FUZZ_XCP
  if ((what & 7U) != 7U) {
    any_command(s, (what >> 3) & 3U);
    return;
  }
  if ((what & 0x38U) != 0U) {
    sample.tick++;
    tick();
    return;
  }
#endif
  switch (what & 7U) {
  case 0:
    raw_bytes(s);
    break;
  case 1:
    request(s, 0);
    break;
  case 2:
    request(s, next8(s));
    break;
  case 3:
    any_sample(s);
    break;
  case 4:
    command(s);
    break;
  case 5:
    if ((what & 0x18U) == 0U) { /* this takes the longest time, so it is done less often */
      download(s);
    } else {
      command(s);
    }
    break;
  case 6:
    any_command(s, (what >> 3) & 3U);
    break;
  default:
    quiet_ticks(s);
    break;
  }
}

static void start(void)
{
  firmware = fresh;
  body = fresh_body;
  memset(&sample, 0, sizeof sample);
  sample.gap = PORT_ONE / 2;
  drive = 0;
  wire_index = 0;
  wire_count = 0;
  link_receiver_start(&line);
  link_receiver_start(&twin);
  answers = 0;
  requests = 0;
  sequence = 0;
  locks = 0;
  last_sample_tick = 0;
  xcp_start(slave, &firmware);
  xcp_line_start(&serial, &firmware, 1);
}

/* Without a session, the firmware performs only a hello. */
static void open_session(void)
{
  uint8_t payload[LINK_SIZE_HELLO] = {LINK_VERSION};
  max_accepted_bytes = UINT16_MAX;
  put_frame(LINK_TYPE_HELLO, payload, sizeof payload, 0);
  poll();
}

static void open_xcp(void)
{
  static const uint8_t connect[2] = {0xFF, 0};
  uint8_t answer[XCP_PACKET];
  require(perform_xcp_command(connect, 2, answer) == 8U);
}

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
  (void)argc;
  (void)argv;
  app_start(&fresh, &body, &board, &port);
  fresh_body = body;
  require(body.compensator.words != NULL);
  return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  script s = {data, size, 0};
  start();
  const uint8_t begin = next8(&s);
  if ((begin & 7U) != 0U) {
    open_session();
  }
  if ((begin & 0x18U) != 0U) {
    open_xcp();
  }
  for (int i = 0; i < MAX_SCRIPT_STEPS && s.at < s.size; i++) {
    step(&s);
  }
  return 0;
}
