/* SPDX-License-Identifier: Apache-2.0 */
#include "app/request.h"

#include <stddef.h>

void app_restart_heartbeat(app *a)
{
  port_lock(a->port);
  a->control.silent_ticks = 0;
  port_unlock(a->port);
}

uint32_t app_last_tick(const app *a)
{
  port_lock(a->port);
  const uint32_t tick = a->control.tick;
  port_unlock(a->port);
  return tick;
}

uint16_t app_active_word(const app *a, uint16_t number)
{
  const int16_t *words = app_body_compensator(a->control.body, 0)->words;
  return words != NULL ? (uint16_t)words[number] : 0U;
}

uint16_t app_set_reference(app *a, uint16_t quantity, int32_t value)
{
  port_lock(a->port);
  const uint16_t reason = app_body_set_reference(a->control.body, quantity, value);
  port_unlock(a->port);
  return reason;
}

uint16_t app_command(app *a, uint16_t command, uint16_t *state)
{
  port_lock(a->port);
  const uint16_t reason = app_control_command(&a->control, command);
  *state = app_body_states(a->control.body)->state;
  port_unlock(a->port);
  return reason;
}

uint16_t app_setting_write(app *a, uint16_t number, int32_t value, uint16_t *state)
{
  port_lock(a->port);
  *state = app_body_states(a->control.body)->state;
  uint16_t reason = app_setting_refusal(a->board, number, value, *state == ANHYST_STATE_RUN);
  if (reason == LINK_REASON_NONE) {
    reason = app_body_setting(a->control.body, a->settings, number, value);
  }
  if (reason == LINK_REASON_NONE) {
    a->settings[number] = value;
  }
  port_unlock(a->port);
  return reason;
}

/* Activates a checked block between two ticks. It is still valid: only this task writes it. */
static void activate_block(app *a, const int16_t *words)
{
  anhyst_compensator new_compensator;
  const int is_first_block = app_body_compensator(a->control.body, 0)->words == NULL;
  if (is_first_block) {
    (void)anhyst_compensator_init(&new_compensator, a->board->kernel, words,
                                  a->download.announced.words);
  }
  port_lock(a->port);
  if (is_first_block) {
    *app_body_compensator(a->control.body, 0) = new_compensator;
    anhyst_compensator *second = app_body_compensator(a->control.body, 1);
    if (second != NULL) {
      *second = new_compensator;
    }
  } else {
    app_body_swap(a->control.body, words);
  }
  port_unlock(a->port);
}

uint16_t app_block_swap(app *a, uint16_t generation, uint16_t *detail)
{
  const int16_t *words = NULL;
  *detail = app_active_word(a, ANHYST_WORD_GENERATION);
  const uint16_t reason = app_download_check(&a->download, a->board, generation, &words, detail);
  if (reason == LINK_REASON_NONE) {
    activate_block(a, words);
    a->download.state = APP_DOWNLOAD_NONE;
    *detail = app_active_word(a, ANHYST_WORD_GENERATION);
  }
  return reason;
}

uint16_t app_block_edit(app *a, uint16_t at, const uint8_t *bytes, uint16_t count)
{
  const int16_t *in_force = app_body_compensator(a->control.body, 0)->words;
  return app_download_edit(&a->download, in_force, at, bytes, count);
}

const int16_t *app_edited_block(const app *a)
{
  return a->download.state == APP_DOWNLOAD_EDITED ? a->download.words[a->download.pending_index]
                                                  : NULL;
}

void app_block_discard_edits(app *a)
{
  if (a->download.state == APP_DOWNLOAD_EDITED) {
    a->download.state = APP_DOWNLOAD_NONE;
  }
}

uint16_t app_block_swap_edited(app *a, uint16_t *detail)
{
  *detail = app_active_word(a, ANHYST_WORD_GENERATION);
  if (a->download.state == APP_DOWNLOAD_RECEIVING) {
    return LINK_REASON_ORDER;
  }
  if (a->download.state == APP_DOWNLOAD_NONE) {
    return LINK_REASON_NONE;
  }
  app_download_finish_edit(&a->download);
  const uint16_t reason = app_block_swap(a, a->download.announced.generation, detail);
  if (reason != LINK_REASON_NONE) {
    a->download.state = APP_DOWNLOAD_EDITED;
  }
  return reason;
}
