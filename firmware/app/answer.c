/* SPDX-License-Identifier: Apache-2.0 */
/* Answers each request of the link with one function. Data of the control task are accessed only
   between port_lock and port_unlock, and only for a short time. */
#include "app/request.h"

#include <stddef.h>

#include "xcp/tunnel.h"

/* Type, length and payload of an answer. */
typedef struct {
  uint8_t *payload;
  uint8_t type;
  uint8_t length;
} answer;

static void put_nak(answer *to, uint16_t request, uint16_t reason, uint16_t detail)
{
  const link_nak nak = {request, reason, detail};
  to->type = LINK_TYPE_NAK;
  to->length = LINK_SIZE_NAK;
  link_put_nak(to->payload, &nak);
}

/* Answers with an acknowledgement if the reason is NONE, otherwise with a refusal (NAK). */
static void put_result(answer *to, uint16_t request, uint16_t reason, uint16_t detail)
{
  if (reason == LINK_REASON_NONE) {
    const link_ack ack = {request, detail};
    to->type = LINK_TYPE_ACK;
    to->length = LINK_SIZE_ACK;
    link_put_ack(to->payload, &ack);
  } else {
    put_nak(to, request, reason, detail);
  }
}

static void put_status(app *a, answer *to)
{
  const app_control *control = &a->control;
  link_status status = {0};
  port_lock(a->port);
  const anhyst_supervisor *states = app_body_states(control->body);
  status.state = (uint8_t)states->state;
  status.fault = (uint8_t)states->fault;
  status.flags = control->flags;
  app_body_status(control->body, &status);
  status.missed_ticks = control->missed_ticks;
  status.cycles = a->max_tick_cycles;
  port_unlock(a->port);
  status.generation = app_active_word(a, ANHYST_WORD_GENERATION);
  status.bad_frames = a->session.receiver.discarded_frames;
  status.lost_frames = a->session.lost_requests;
  to->type = LINK_TYPE_STATUS;
  to->length = LINK_SIZE_STATUS;
  link_put_status(to->payload, &status);
}

static void put_status_or_nak(app *a, answer *to, uint16_t request, uint16_t reason)
{
  if (reason == LINK_REASON_NONE) {
    put_status(a, to);
  } else {
    put_nak(to, request, reason, 0);
  }
}

static void on_hello(app *a, const uint8_t *p, answer *to)
{
  const app_board *board = a->board;
  link_hello hello;
  link_get_hello(&hello, p);
  if (hello.version != LINK_VERSION) {
    put_nak(to, LINK_TYPE_HELLO, LINK_REASON_VERSION, LINK_VERSION);
    return;
  }
  link_info info;
  info.version = LINK_VERSION;
  info.firmware = board->firmware;
  info.kind = board->kernel->kind;
  info.layout = ANHYST_BLOCK_LAYOUT;
  info.generation = app_active_word(a, ANHYST_WORD_GENERATION);
  info.capacity = ANHYST_BLOCK_MOST_WORDS;
  info.ramp = board->limits->ramp_ms;
  info.model = app_active_word(a, ANHYST_WORD_MODEL) |
               ((uint32_t)app_active_word(a, ANHYST_WORD_MODEL + 1) << 16);
  info.rate = board->rate;
  info.body = board->plan != NULL ? LINK_BODY_POSITION : LINK_BODY_FORCE;
  info.magnets = app_body_compensator(a->control.body, 1) != NULL ? 2U : 1U;
  to->type = LINK_TYPE_INFO;
  to->length = LINK_SIZE_INFO;
  link_put_info(to->payload, &info);
}

static void on_heartbeat(app *a, const uint8_t *p, answer *to)
{
  (void)p;
  put_status(a, to);
}

static void on_demand(app *a, const uint8_t *p, answer *to)
{
  put_status_or_nak(a, to, LINK_TYPE_DEMAND,
                    app_set_reference(a, LINK_BODY_FORCE, link_get_demand(p)));
}

static void on_target(app *a, const uint8_t *p, answer *to)
{
  put_status_or_nak(a, to, LINK_TYPE_TARGET,
                    app_set_reference(a, LINK_BODY_POSITION, link_get_target(p)));
}

static void on_command(app *a, const uint8_t *p, answer *to)
{
  uint16_t state = 0;
  const uint16_t reason = app_command(a, link_get_command(p), &state);
  put_result(to, LINK_TYPE_COMMAND, reason, state);
}

static void put_setting(const app *a, uint16_t number, answer *to)
{
  const link_setting setting = {number, a->settings[number]};
  to->type = LINK_TYPE_SETTING;
  to->length = LINK_SIZE_SETTING;
  link_put_setting(to->payload, &setting);
}

static void on_setting_read(app *a, const uint8_t *p, answer *to)
{
  const uint16_t number = link_get_setting_read(p);
  if (number >= LINK_SETTING_COUNT) {
    put_nak(to, LINK_TYPE_SETTING_READ, LINK_REASON_VALUE, 0);
  } else {
    put_setting(a, number, to);
  }
}

static void on_setting_write(app *a, const uint8_t *p, answer *to)
{
  link_setting_write write;
  link_get_setting_write(&write, p);
  uint16_t state = 0;
  const uint16_t reason = app_setting_write(a, write.setting, write.value, &state);
  if (reason != LINK_REASON_NONE) {
    put_nak(to, LINK_TYPE_SETTING_WRITE, reason, state);
  } else {
    put_setting(a, write.setting, to);
  }
}

static void on_block_begin(app *a, const uint8_t *p, answer *to)
{
  link_block_begin begin;
  link_get_block_begin(&begin, p);
  const uint16_t reason =
      app_download_begin(&a->download, &begin, app_body_compensator(a->control.body, 0)->words);
  put_result(to, LINK_TYPE_BLOCK_BEGIN, reason, 0);
}

static void on_block_swap(app *a, const uint8_t *p, answer *to)
{
  uint16_t detail = 0;
  const uint16_t reason = app_block_swap(a, link_get_block_swap(p), &detail);
  put_result(to, LINK_TYPE_BLOCK_SWAP, reason, detail);
}

static void on_block_read(app *a, const uint8_t *p, answer *to)
{
  const uint16_t max_words = (LINK_MAX_PAYLOAD - LINK_SIZE_BLOCK_WORDS) / 2;
  const uint16_t length = app_active_word(a, ANHYST_WORD_LENGTH);
  link_block_read read;
  link_get_block_read(&read, p);
  if (read.words == 0U || read.words > max_words || read.offset >= length ||
      read.words > length - read.offset) {
    put_nak(to, LINK_TYPE_BLOCK_READ, LINK_REASON_VALUE, length);
    return;
  }
  link_put_block_words(to->payload, read.offset);
  uint8_t *at = to->payload + LINK_SIZE_BLOCK_WORDS;
  for (uint16_t i = 0; i < read.words; i++, at += 2) {
    link_put_u16(at, app_active_word(a, (uint16_t)(read.offset + i)));
  }
  to->type = LINK_TYPE_BLOCK_WORDS;
  to->length = (uint8_t)(LINK_SIZE_BLOCK_WORDS + 2U * read.words);
}

static void on_store_block(app *a, const uint8_t *p, answer *to)
{
  const uint16_t zero_current_flag = ANHYST_CURRENT_ZERO;
  const uint16_t conditioning_flag = ANHYST_CONDITIONING;
  (void)p;
  port_lock(a->port);
  const int16_t *words = app_body_compensator(a->control.body, 0)->words;
  const uint16_t state = app_body_states(a->control.body)->state;
  const int is_at_rest =
      (state == ANHYST_STATE_IDLE || state == ANHYST_STATE_READY) &&
      (a->control.flags & (zero_current_flag | conditioning_flag)) == zero_current_flag;
  port_unlock(a->port);
  if (!is_at_rest || words == NULL) {
    put_nak(to, LINK_TYPE_KEEP, LINK_REASON_STATE, state);
  } else {
    const uint16_t length = (uint16_t)words[ANHYST_WORD_LENGTH];
    const int is_stored = a->port->keep(a->port->context, words, length);
    put_result(to, LINK_TYPE_KEEP, is_stored ? LINK_REASON_NONE : LINK_REASON_NOT_KEPT,
               app_active_word(a, ANHYST_WORD_GENERATION));
  }
}

/* Type and fixed length of a request, and the function that answers it. */
typedef struct {
  uint8_t type;
  uint8_t length;
  void (*on)(app *a, const uint8_t *p, answer *to);
} request_kind;

static const request_kind kinds[] = {
    {LINK_TYPE_HELLO, LINK_SIZE_HELLO, on_hello},
    {LINK_TYPE_HEARTBEAT, LINK_SIZE_HEARTBEAT, on_heartbeat},
    {LINK_TYPE_DEMAND, LINK_SIZE_DEMAND, on_demand},
    {LINK_TYPE_TARGET, LINK_SIZE_TARGET, on_target},
    {LINK_TYPE_COMMAND, LINK_SIZE_COMMAND, on_command},
    {LINK_TYPE_SETTING_READ, LINK_SIZE_SETTING_READ, on_setting_read},
    {LINK_TYPE_SETTING_WRITE, LINK_SIZE_SETTING_WRITE, on_setting_write},
    {LINK_TYPE_BLOCK_BEGIN, LINK_SIZE_BLOCK_BEGIN, on_block_begin},
    {LINK_TYPE_BLOCK_SWAP, LINK_SIZE_BLOCK_SWAP, on_block_swap},
    {LINK_TYPE_BLOCK_READ, LINK_SIZE_BLOCK_READ, on_block_read},
    {LINK_TYPE_KEEP, LINK_SIZE_KEEP, on_store_block},
};

/* Requires complete words, and at least one word. */
static void on_block_data(app *a, const link_frame *request, answer *to)
{
  const uint8_t *p = request->payload;
  const uint8_t tail = (uint8_t)(request->length - LINK_SIZE_BLOCK_DATA);
  if (request->length < LINK_SIZE_BLOCK_DATA + 2 || tail % 2U != 0U) {
    put_nak(to, request->type, LINK_REASON_LENGTH, request->length);
  } else {
    const uint16_t reason = app_download_words(&a->download, link_get_block_data(p),
                                               p + LINK_SIZE_BLOCK_DATA, (uint16_t)(tail / 2U));
    put_result(to, LINK_TYPE_BLOCK_DATA, reason, a->download.received_words);
  }
}

uint8_t app_answer(app *a, const link_frame *request, uint8_t *payload, uint8_t *length)
{
  answer to = {payload, 0, 0};
  const request_kind *kind = NULL;
  for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
    if (kinds[i].type == request->type) {
      kind = &kinds[i];
    }
  }
  if (request->type == LINK_TYPE_BLOCK_DATA) {
    on_block_data(a, request, &to);
  } else if (request->type == (uint8_t)LINK_TYPE_XCP) {
    to.type = LINK_TYPE_XCP_PACKETS;
    to.length = (uint8_t)xcp_tunnel(&a->carried, request->payload, request->length, payload);
  } else if (kind == NULL) {
    put_nak(&to, request->type, LINK_REASON_TYPE, 0);
  } else if (request->length != kind->length) {
    put_nak(&to, request->type, LINK_REASON_LENGTH, request->length);
  } else {
    kind->on(a, request->payload, &to);
  }
  *length = to.length;
  return to.type;
}
