/* SPDX-License-Identifier: Apache-2.0 */
/* Frames of the link and records of the plant's bus: made by tools/contract from
   contract/frames.toml and signals.toml, which say what they mean. Do not edit. */
/* clang-format off */
#ifndef ANHYST_LINK_FRAMES_H
#define ANHYST_LINK_FRAMES_H

#include "link/bytes.h"

#define LINK_VERSION 4
#define LINK_PAYLOAD_MOST 240
#define LINK_PLANT_MAGIC UINT32_C(0x616E6879)

/* Types of frames. */
enum {
  /* Opens a session: the sequence numbers start again with this frame. If this session is already
     open, the frame is answered and has no effect. */
  LINK_TYPE_HELLO = 1,
  LINK_TYPE_HEARTBEAT = 2, /* Requests the status. */
  /* The demanded force, valid from the next tick on. No effect outside the state run and on a
     position controller. */
  LINK_TYPE_DEMAND = 3,
  LINK_TYPE_COMMAND = 4, /* Changes the state. Detail of the answer: the new state. */
  LINK_TYPE_SETTING_READ = 5, /* Requests a setting. */
  LINK_TYPE_SETTING_WRITE = 6, /* Changes a setting, valid from the next tick on. */
  /* Announces a parameter block and discards words of an incomplete one. */
  LINK_TYPE_BLOCK_BEGIN = 7,
  /* The next words of the block. Detail of the answer: the next offset. */
  LINK_TYPE_BLOCK_DATA = 8,
  /* Checks the block and activates it between two ticks. After an error, the old block remains
     active. Detail of the answer: the generation of the active block. */
  LINK_TYPE_BLOCK_SWAP = 9,
  LINK_TYPE_BLOCK_READ = 10, /* Requests words of the active block. */
  /* The target position, valid from the next tick on; before a lift, the first target. A position
     outside the range is rejected, and a force controller rejects every target. */
  LINK_TYPE_TARGET = 14,
  /* Stores the active block for the next start, if the board has non-volatile memory. Allowed only
     in idle or ready at zero current, because the board may stop its ticks for seconds. Detail: the
     generation of the block. */
  LINK_TYPE_KEEP = 15,
  /* An XCP command; an empty frame requests only samples. Only the command of an unlocked master
     counts as a heartbeat, not the frame. */
  LINK_TYPE_XCP = 16,
  LINK_TYPE_INFO = 129, /* Identification of the controller. */
  LINK_TYPE_STATUS = 130, /* State and signals of the tick in the header. */
  LINK_TYPE_ACK = 131, /* The request was executed. */
  LINK_TYPE_NAK = 132, /* The request was rejected and had no effect. */
  LINK_TYPE_SETTING = 133, /* The value of a setting. */
  LINK_TYPE_BLOCK_WORDS = 134, /* Words of the active block. */
  /* The answer to the command, then events and samples; each packet follows its length. */
  LINK_TYPE_XCP_PACKETS = 137,
  LINK_TYPE_COUNT = 20
};

/* Reasons for rejecting a request (NAK). */
enum {
  LINK_REASON_NONE = 0,
  LINK_REASON_VERSION = 1, /* different protocol version; detail: the controller's version */
  LINK_REASON_TYPE = 2, /* unknown request */
  LINK_REASON_LENGTH = 3, /* wrong length of the payload; detail: its length */
  /* the sequence number is older than the last one; detail: 1 if a request with this number was
     answered, otherwise 0 */
  LINK_REASON_OLD = 4,
  LINK_REASON_STATE = 5, /* not allowed in this state; detail: the state */
  LINK_REASON_VALUE = 6, /* value out of range, or unknown setting, command or word */
  /* block data without block_begin or with a wrong offset; detail: the expected offset */
  LINK_REASON_ORDER = 7,
  LINK_REASON_CHECKSUM = 8, /* the received block does not have the announced checksum */
  LINK_REASON_BLOCK = 9, /* the block is invalid, or has a different kind or layout */
  LINK_REASON_GENERATION = 10, /* the block has a different generation; detail: its generation */
  LINK_REASON_SESSION = 11, /* no session is open: send hello first */
  LINK_REASON_CURRENT = 12, /* current still flows; repeat the request at zero current */
  /* the block has different full scales, gaps, rate or units; detail: the first word that differs
     */
  LINK_REASON_SCALE = 13,
  LINK_REASON_NOT_KEPT = 14, /* the board has no non-volatile memory, or writing failed */
  LINK_REASON_COUNT = 15
};

/* The controlled quantity. */
enum {
  LINK_BODY_FORCE = 0, /* the force of a magnet */
  LINK_BODY_POSITION = 1, /* the position of a levitating armature */
  LINK_BODY_COUNT = 2
};

/* Settings. */
enum {
  /* maximum number of ticks between two requests; afterwards the link counts as lost; the board has
     its own upper limit */
  LINK_SETTING_HEARTBEAT_TICKS = 0,
  LINK_SETTING_DEMAND_SLEW = 1, /* largest change of the demand per tick, q31 */
  LINK_SETTING_COMPENSATION = 2, /* 1: the compensator; 0: a constant force-current ratio */
  LINK_SETTING_RATIO = 3, /* constant ratio of current to demand, q30 */
  /* current that updates the hysteresis state. 0: commanded; 1: measured */
  LINK_SETTING_FOLLOW = 4,
  /* 0: built-in gains; 1: built-in gains times gain_p to gain_dd, read when this setting is written
     */
  LINK_SETTING_GAINS = 5,
  LINK_SETTING_GAIN_P = 6, /* factor of the built-in proportional gain, q30 */
  LINK_SETTING_GAIN_I = 7, /* factor of the built-in integral gain, q30 */
  LINK_SETTING_GAIN_D = 8, /* factor of the built-in gain of the first derivative, q30 */
  LINK_SETTING_GAIN_DD = 9, /* factor of the built-in gain of the second derivative, q30 */
  /* largest difference between measured and commanded current, q31 */
  LINK_SETTING_CURRENT_TOLERANCE = 10,
  /* longest time constant of amplifier and current sensor, ticks */
  LINK_SETTING_CURRENT_LAG_TICKS = 11,
  /* time in which the amplifier can change the current by the full scale, ticks */
  LINK_SETTING_CURRENT_SWEEP_TICKS = 12,
  /* number of consecutive samples beyond current_tolerance that cause a fault */
  LINK_SETTING_CURRENT_OFF_TICKS = 13,
  LINK_SETTING_COUNT = 14
};

/* What can be read at every tick. */
enum {
  LINK_SIGNAL_DEMAND = 0, /* active demand, q31 of the full-scale force */
  LINK_SIGNAL_FORCE = 1, /* measured force, q30 */
  LINK_SIGNAL_GAP = 2, /* measured gap, q30 */
  LINK_SIGNAL_CURRENT = 3, /* measured current, q30 */
  LINK_SIGNAL_DRIVE = 4, /* commanded current, q31 of the full-scale current */
  LINK_SIGNAL_FLUX = 5, /* flux of the model after the commit, q30 */
  LINK_SIGNAL_EXPECTED = 6, /* force of the model after the commit, q31 */
  LINK_SIGNAL_STATE = 7, /* state, as a number */
  LINK_SIGNAL_FLAGS = 8, /* flags, as in status */
  LINK_SIGNAL_POSITION = 9, /* measured position, q31 of the controller's full scale */
  LINK_SIGNAL_REFERENCE = 10, /* reference position, q31 of the controller's full scale */
  LINK_SIGNAL_PHASE = 11, /* phase, as a number */
  LINK_SIGNAL_CURRENT_2 = 12, /* measured current of the second magnet, q30 */
  LINK_SIGNAL_DRIVE_2 = 13, /* commanded current of the second magnet, q31 */
  LINK_SIGNAL_FAULT = 14, /* latched reason of a fault, as a number */
  LINK_SIGNAL_COUNT = 15
};

/* Low, high, value at the start, this in ms if it is a time (else 0), whether it may be
   written in the state run. */
#define LINK_SETTING_TABLE \
  {INT32_C(2), INT32_C(1000000), INT32_C(0), 100, 1}, /* heartbeat_ticks */ \
  {INT32_C(1), INT32_C(2147483647), INT32_C(2147483647), 0, 1}, /* demand_slew */ \
  {INT32_C(0), INT32_C(1), INT32_C(1), 0, 1}, /* compensation */ \
  {INT32_MIN, INT32_C(2147483647), INT32_C(1073741824), 0, 0}, /* ratio */ \
  {INT32_C(0), INT32_C(1), INT32_C(0), 0, 0}, /* follow */ \
  {INT32_C(0), INT32_C(1), INT32_C(0), 0, 1}, /* gains */ \
  {INT32_C(536870912), INT32_C(2147483647), INT32_C(1073741824), 0, 1}, /* gain_p */ \
  {INT32_C(0), INT32_C(2147483647), INT32_C(1073741824), 0, 1}, /* gain_i */ \
  {INT32_C(536870912), INT32_C(2147483647), INT32_C(1073741824), 0, 1}, /* gain_d */ \
  {INT32_C(0), INT32_C(2147483647), INT32_C(1073741824), 0, 1}, /* gain_dd */ \
  {INT32_C(1), INT32_C(536870911), INT32_C(107374182), 0, 0}, /* current_tolerance */ \
  {INT32_C(3), INT32_C(1000000), INT32_C(0), 5, 0}, /* current_lag_ticks */ \
  {INT32_C(1), INT32_C(1000000), INT32_C(0), 50, 0}, /* current_sweep_ticks */ \
  {INT32_C(1), INT32_C(1000000), INT32_C(0), 20, 0}, /* current_off_ticks */

#define LINK_SIZE_HELLO 6
typedef struct {
  uint16_t version; /* protocol version of the PC */
  uint32_t session; /* random number of the session, chosen by the PC */
} link_hello;
static inline void link_get_hello(link_hello *m, const uint8_t *p)
{
  m->version = link_get_u16(p + 0);
  m->session = link_get_u32(p + 2);
}

#define LINK_SIZE_HEARTBEAT 0

#define LINK_SIZE_DEMAND 4
/* force: q31 of the full-scale force */
static inline int32_t link_get_demand(const uint8_t *p) { return link_get_i32(p); }

#define LINK_SIZE_COMMAND 2
/* command: one of command */
static inline uint16_t link_get_command(const uint8_t *p) { return link_get_u16(p); }

#define LINK_SIZE_SETTING_READ 2
/* setting: one of setting */
static inline uint16_t link_get_setting_read(const uint8_t *p) { return link_get_u16(p); }

#define LINK_SIZE_SETTING_WRITE 6
typedef struct {
  uint16_t setting; /* one of setting */
  int32_t value;
} link_setting_write;
static inline void link_get_setting_write(link_setting_write *m, const uint8_t *p)
{
  m->setting = link_get_u16(p + 0);
  m->value = link_get_i32(p + 2);
}

#define LINK_SIZE_BLOCK_BEGIN 8
typedef struct {
  uint16_t words; /* length of the block */
  uint16_t generation; /* generation of the block */
  uint32_t checksum; /* CRC-32 of all its words, low byte first */
} link_block_begin;
static inline void link_get_block_begin(link_block_begin *m, const uint8_t *p)
{
  m->words = link_get_u16(p + 0);
  m->generation = link_get_u16(p + 2);
  m->checksum = link_get_u32(p + 4);
}

#define LINK_SIZE_BLOCK_DATA 2
/* offset: offset of the first word in the block */
static inline uint16_t link_get_block_data(const uint8_t *p) { return link_get_u16(p); }

#define LINK_SIZE_BLOCK_SWAP 2
/* generation: generation of the block */
static inline uint16_t link_get_block_swap(const uint8_t *p) { return link_get_u16(p); }

#define LINK_SIZE_BLOCK_READ 4
typedef struct {
  uint16_t offset; /* first requested word */
  uint16_t words; /* number of words, 1..118 */
} link_block_read;
static inline void link_get_block_read(link_block_read *m, const uint8_t *p)
{
  m->offset = link_get_u16(p + 0);
  m->words = link_get_u16(p + 2);
}

#define LINK_SIZE_TARGET 4
/* position: q31 of the position controller's full scale */
static inline int32_t link_get_target(const uint8_t *p) { return link_get_i32(p); }

#define LINK_SIZE_KEEP 0

#define LINK_SIZE_XCP 0

#define LINK_SIZE_INFO 26
typedef struct {
  uint16_t version; /* protocol version */
  uint16_t firmware; /* version of the firmware: 256*major + minor */
  uint16_t kind; /* kind of compensator (ANHYST_KIND_...) */
  uint16_t layout; /* layout of the parameter blocks */
  uint16_t generation; /* generation of the active block */
  uint16_t capacity; /* maximum number of words of a parameter block */
  uint16_t ramp; /* time from full current to zero in the safe state, ms */
  uint32_t model; /* first 32 bits of the model's hash */
  uint32_t rate; /* ticks per second */
  uint16_t body; /* controlled quantity, one of body */
  uint16_t magnets; /* number of magnets: 1, or an opposing pair */
} link_info;
static inline void link_put_info(uint8_t *p, const link_info *m)
{
  link_put_u16(p + 0, m->version);
  link_put_u16(p + 2, m->firmware);
  link_put_u16(p + 4, m->kind);
  link_put_u16(p + 6, m->layout);
  link_put_u16(p + 8, m->generation);
  link_put_u16(p + 10, m->capacity);
  link_put_u16(p + 12, m->ramp);
  link_put_u32(p + 14, m->model);
  link_put_u32(p + 18, m->rate);
  link_put_u16(p + 22, m->body);
  link_put_u16(p + 24, m->magnets);
}

#define LINK_SIZE_STATUS 54
typedef struct {
  uint8_t state; /* one of state */
  uint8_t fault; /* latched reason, one of fault */
  uint16_t flags; /* bits of flag */
  int32_t demand; /* active demand, q31 */
  int32_t force; /* measured force, q30 */
  int32_t gap; /* measured gap, q30 */
  int32_t current[2]; /* measured current, q30; measured current of the second magnet, q30 */
  int32_t drive[2]; /* commanded current, q31; commanded current of the second magnet, q31 */
  uint16_t generation; /* generation of the active block */
  uint16_t bad_frames; /* damaged frames, modulo 65536 */
  uint16_t lost_frames; /* missing sequence numbers, modulo 65536 */
  uint16_t missed_ticks; /* missed ticks since power-on, modulo 65536 */
  uint16_t phase; /* one of phase */
  int32_t position; /* last plausible position, q31 */
  int32_t reference; /* reference position, q31 */
  uint32_t cycles; /* processor cycles of the longest tick; 0: not counted */
} link_status;
static inline void link_put_status(uint8_t *p, const link_status *m)
{
  link_put_u8(p + 0, m->state);
  link_put_u8(p + 1, m->fault);
  link_put_u16(p + 2, m->flags);
  link_put_u32(p + 4, (uint32_t)m->demand);
  link_put_u32(p + 8, (uint32_t)m->force);
  link_put_u32(p + 12, (uint32_t)m->gap);
  link_put_u32(p + 16, (uint32_t)m->current[0]);
  link_put_u32(p + 20, (uint32_t)m->drive[0]);
  link_put_u16(p + 24, m->generation);
  link_put_u16(p + 26, m->bad_frames);
  link_put_u16(p + 28, m->lost_frames);
  link_put_u16(p + 30, m->missed_ticks);
  link_put_u16(p + 32, m->phase);
  link_put_u32(p + 34, (uint32_t)m->position);
  link_put_u32(p + 38, (uint32_t)m->reference);
  link_put_u32(p + 42, (uint32_t)m->current[1]);
  link_put_u32(p + 46, (uint32_t)m->drive[1]);
  link_put_u32(p + 50, m->cycles);
}

#define LINK_SIZE_ACK 4
typedef struct {
  uint16_t request; /* type of the request */
  uint16_t detail; /* see the request */
} link_ack;
static inline void link_put_ack(uint8_t *p, const link_ack *m)
{
  link_put_u16(p + 0, m->request);
  link_put_u16(p + 2, m->detail);
}

#define LINK_SIZE_NAK 6
typedef struct {
  uint16_t request; /* type of the request */
  uint16_t reason; /* one of reason */
  uint16_t detail; /* see the reason */
} link_nak;
static inline void link_put_nak(uint8_t *p, const link_nak *m)
{
  link_put_u16(p + 0, m->request);
  link_put_u16(p + 2, m->reason);
  link_put_u16(p + 4, m->detail);
}

#define LINK_SIZE_SETTING 6
typedef struct {
  uint16_t setting; /* one of setting */
  int32_t value;
} link_setting;
static inline void link_put_setting(uint8_t *p, const link_setting *m)
{
  link_put_u16(p + 0, m->setting);
  link_put_u32(p + 2, (uint32_t)m->value);
}

#define LINK_SIZE_BLOCK_WORDS 2
/* offset: offset of the first word */
static inline void link_put_block_words(uint8_t *p, uint16_t offset) { link_put_u16(p + 0, offset); }

#define LINK_SIZE_XCP_PACKETS 0

#define LINK_SIZE_PLANT_SAMPLE 32
/* Plant to controller: the sensor readings at the beginning of a tick. */
typedef struct {
  uint32_t tick; /* counts from 1 */
  int32_t gap; /* q30: 0 is the low end of the model's gaps, 1.0 the high one */
  int32_t force; /* q30 of the full-scale force */
  int32_t position; /* q31 of the position controller's full scale */
  /* current of the first magnet, q30 of full scale; current of the second magnet, q30 of full scale
     */
  int32_t current[2];
  uint32_t status; /* bits of PORT_... in port/port.h */
} link_plant_sample;
/* Whether the record is valid; fills it either way. */
static inline int link_get_plant_sample(link_plant_sample *m, const uint8_t *p)
{
  m->tick = link_get_u32(p + 0);
  m->gap = link_get_i32(p + 4);
  m->force = link_get_i32(p + 8);
  m->position = link_get_i32(p + 12);
  m->current[0] = link_get_i32(p + 16);
  m->current[1] = link_get_i32(p + 20);
  m->status = link_get_u32(p + 24);
  return (link_get_u32(p + 0) ^ link_get_u32(p + 4) ^ link_get_u32(p + 8) ^ link_get_u32(p + 12) ^ link_get_u32(p + 16) ^ link_get_u32(p + 20) ^ link_get_u32(p + 24) ^ link_get_u32(p + 28)) == LINK_PLANT_MAGIC;
}

#define LINK_SIZE_PLANT_DRIVE 40
/* Controller to plant: the currents from the beginning of the next tick on, and signals of the
   controller for recordings. */
typedef struct {
  uint32_t tick; /* tick of the sample from which the record was computed */
  /* commanded current of the first magnet, q31 of full scale; commanded current of the second
     magnet, q31 of full scale */
  int32_t drive[2];
  uint32_t state; /* state + 256*fault */
  uint32_t mode; /* flags + 65536*phase */
  int32_t demand; /* active demand, q31 of the full-scale force */
  int32_t reference; /* reference position, q31 of the controller's full scale */
  int32_t flux; /* flux of the first magnet's model after the commit, q30 */
  int32_t expected; /* force of this model, q31 */
} link_plant_drive;
static inline void link_put_plant_drive(uint8_t *p, const link_plant_drive *m)
{
  link_put_u32(p + 0, m->tick);
  link_put_u32(p + 4, (uint32_t)m->drive[0]);
  link_put_u32(p + 8, (uint32_t)m->drive[1]);
  link_put_u32(p + 12, m->state);
  link_put_u32(p + 16, m->mode);
  link_put_u32(p + 20, (uint32_t)m->demand);
  link_put_u32(p + 24, (uint32_t)m->reference);
  link_put_u32(p + 28, (uint32_t)m->flux);
  link_put_u32(p + 32, (uint32_t)m->expected);
  link_put_u32(p + 36, link_get_u32(p + 0) ^ link_get_u32(p + 4) ^ link_get_u32(p + 8) ^ link_get_u32(p + 12) ^ link_get_u32(p + 16) ^ link_get_u32(p + 20) ^ link_get_u32(p + 24) ^ link_get_u32(p + 28) ^ link_get_u32(p + 32) ^ LINK_PLANT_MAGIC);
}

#endif
