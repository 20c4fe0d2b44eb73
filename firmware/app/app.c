/* SPDX-License-Identifier: Apache-2.0 */
#include "app/request.h"

#include <stddef.h>

static void session_start(app_session *session)
{
  link_receiver_start(&session->receiver);
  session->next_byte = session->answer;
  session->request_crc = 0;
  session->answered_mask = 0;
  session->chunk_count = 0;
  session->chunk_index = 0;
  session->answer_count = 0;
  session->unsent_count = 0;
  session->last_sequence = 0;
  session->session_number = 0;
  session->is_open = 0;
  session->lost_requests = 0;
}

void app_start(app *a, app_body *body, const app_board *board, const struct port *port)
{
  a->port = port;
  a->board = board;
  app_settings_start(a->settings, board);
  app_control_start(&a->control, body, board);
  session_start(&a->session);
  for (uint16_t i = 0; i < (uint16_t)LINK_SIGNAL_COUNT; i++) {
    a->signals[i] = 0;
  }
  app_download_start(&a->download);
  xcp_start(&a->carried, a);
  a->max_tick_cycles = 0;
}

void app_tick(app *a)
{
  port_sample sample;
  a->port->sense(a->port->context, &sample);
  if ((sample.status & PORT_NO_SAMPLE) != 0U) {
    sample.gap = PORT_RESERVED;
    sample.force = PORT_RESERVED;
    sample.position = PORT_RESERVED;
    sample.current[0] = PORT_RESERVED;
    sample.current[1] = PORT_RESERVED;
  }
  int32_t drive[PORT_CURRENTS];
  app_control_tick(&a->control, a->board, a->settings, &sample, drive);
  const anhyst_supervisor *states = app_body_states(a->control.body);
  const anhyst_compensator *compensator = app_body_compensator(a->control.body, 0);
  a->port->drive(a->port->context, drive, states->state + 256U * states->fault);
  app_body_signals(a->control.body, &sample, a->signals);
  a->signals[LINK_SIGNAL_CURRENT] = sample.current[0];
  a->signals[LINK_SIGNAL_FLUX] = compensator->flux_applied;
  a->signals[LINK_SIGNAL_EXPECTED] =
      compensator->words != NULL ? anhyst_compensator_output_q31(compensator) : 0;
  a->signals[LINK_SIGNAL_STATE] = states->state;
  a->signals[LINK_SIGNAL_FLAGS] = a->control.flags;
  a->signals[LINK_SIGNAL_FAULT] = states->fault;
  xcp_tick(&a->carried);
}

/* Relation of a request to earlier requests. */
enum {
  SEQUENCE_NEW,       /* new: must be performed */
  SEQUENCE_REPEATED,  /* repetition of the last request: the same answer is sent again */
  SEQUENCE_OLD,       /* overtaken by newer requests: refused */
  SEQUENCE_UNCHANGED, /* a hello that opens no session: answered; the sequence is unchanged */
  SEQUENCE_NO_SESSION
};

/* Opens a session. A hello with a wrong length or version opens none; its answer gives the reason.
   A delayed copy of the last hello opens none either, and cannot reset the sequence. */
static int classify_hello(app_session *session, const link_frame *request)
{
  link_hello hello;
  if (request->length != LINK_SIZE_HELLO) {
    return SEQUENCE_UNCHANGED;
  }
  link_get_hello(&hello, request->payload);
  if (hello.version != LINK_VERSION ||
      (session->is_open != 0U && hello.session == session->session_number)) {
    return SEQUENCE_UNCHANGED;
  }
  session->is_open = 1;
  session->session_number = hello.session;
  session->answered_mask = 1;
  session->last_sequence = request->sequence;
  session->request_crc = request->crc;
  return SEQUENCE_NEW;
}

/* Classifies a request by its sequence number. A PC numbers its requests one after the other; an
   equal frame is a repetition. Requests 1..127 ahead of the last are new. All others were
   overtaken: performing such a request now would undo a later one. */
static int classify_request(app_session *session, const link_frame *request)
{
  const uint16_t ahead = (uint16_t)(request->sequence - session->last_sequence) & 0xFFU;
  if (session->is_open != 0U && ahead == 0U && request->crc == session->request_crc) {
    return SEQUENCE_REPEATED;
  }
  if (request->type == LINK_TYPE_HELLO) {
    return classify_hello(session, request);
  }
  if (session->is_open == 0U) {
    return SEQUENCE_NO_SESSION;
  }
  if (ahead == 0U || ahead > 127U) {
    return SEQUENCE_OLD;
  }
  session->answered_mask = (ahead < 32U ? session->answered_mask << ahead : 0U) | 1U;
  session->lost_requests = (uint16_t)(session->lost_requests + ahead - 1U);
  session->last_sequence = request->sequence;
  session->request_crc = request->crc;
  return SEQUENCE_NEW;
}

/* Whether a request before the last one was answered. The record covers the last 32 numbers. */
static int was_answered(const app_session *session, uint8_t sequence)
{
  const uint16_t behind = (uint16_t)(session->last_sequence - sequence) & 0xFFU;
  return behind < 32U && ((session->answered_mask >> behind) & 1U) != 0U;
}

/* Refuses a request. The refusal goes to the buffer for answers that are not repeated. */
static void refuse_request(app *a, const link_frame *request, uint16_t reason, uint16_t detail)
{
  uint8_t payload[LINK_SIZE_NAK];
  const link_nak nak = {request->type, reason, detail};
  const link_frame frame = {
      LINK_VERSION, LINK_TYPE_NAK, request->sequence, LINK_SIZE_NAK, app_last_tick(a), payload, 0};
  link_put_nak(payload, &nak);
  a->session.next_byte = a->session.unrepeated;
  a->session.unsent_count = link_encode(a->session.unrepeated, &frame);
}

/* Performs a request and encodes its answer into one of the two buffers. */
static void answer_request(app *a, const link_frame *request, uint8_t *wire)
{
  uint8_t payload[LINK_MAX_PAYLOAD];
  link_frame frame = {LINK_VERSION, 0, request->sequence, 0, 0, payload, 0};
  frame.type = app_answer(a, request, payload, &frame.length);
  frame.tick = app_last_tick(a);
  a->session.unsent_count = link_encode(wire, &frame);
  a->session.next_byte = wire;
}

/* Performs a new request. Only new requests count as a heartbeat, because a repetition may be an
   echo of the line. XCP packets are not a heartbeat, because an XCP master may only measure. */
static void answer_new_request(app *a, const link_frame *request)
{
  if (request->type != (uint8_t)LINK_TYPE_XCP) {
    app_restart_heartbeat(a);
  }
  answer_request(a, request, a->session.answer);
  a->session.answer_count = a->session.unsent_count;
}

/* Answers a valid frame of any type. */
static void handle_request(app *a, const link_frame *request)
{
  app_session *session = &a->session;
  if (request->version != LINK_VERSION) {
    refuse_request(a, request, LINK_REASON_VERSION, LINK_VERSION);
    return;
  }
  switch (classify_request(session, request)) {
  case SEQUENCE_NEW:
    answer_new_request(a, request);
    break;
  case SEQUENCE_REPEATED:
    session->next_byte = session->answer;
    session->unsent_count = session->answer_count;
    break;
  case SEQUENCE_OLD:
    refuse_request(a, request, LINK_REASON_OLD, was_answered(session, request->sequence) ? 1 : 0);
    break;
  case SEQUENCE_UNCHANGED:
    answer_request(a, request, session->unrepeated);
    break;
  default:
    refuse_request(a, request, LINK_REASON_SESSION, 0);
    break;
  }
}

/* Passes unsent bytes to the port. Returns 1 once all bytes are sent. */
static int send_pending_bytes(app *a)
{
  app_session *session = &a->session;
  if (session->unsent_count > 0U) {
    const uint16_t sent =
        a->port->link_write(a->port->context, session->next_byte, session->unsent_count);
    session->next_byte += sent;
    session->unsent_count = (uint16_t)(session->unsent_count - sent);
  }
  return session->unsent_count == 0U;
}

void app_poll(app *a)
{
  app_session *session = &a->session;
  link_frame request;
  if (!send_pending_bytes(a)) {
    return;
  }
  if (session->chunk_index == session->chunk_count) {
    session->chunk_index = 0;
    session->chunk_count =
        a->port->link_read(a->port->context, session->chunk, (uint16_t)sizeof session->chunk);
  }
  while (session->chunk_index < session->chunk_count) {
    if (link_receive(&session->receiver, session->chunk[session->chunk_index++], &request)) {
      handle_request(a, &request);
      if (!send_pending_bytes(a)) {
        return;
      }
    }
  }
}
