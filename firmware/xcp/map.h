/* SPDX-License-Identifier: Apache-2.0 */
/* What a master of XCP sees: made by tools/contract from contract/xcp.toml and signals.toml. Do not
   edit. */
/* clang-format off */
#ifndef ANHYST_XCP_MAP_H
#define ANHYST_XCP_MAP_H

#define XCP_PACKET 136 /* most bytes of a command, an answer and a sample */
#define XCP_LISTS 4 /* lists of samples */
#define XCP_ODTS 8 /* parts of lists */
#define XCP_ENTRIES 32 /* signals in all lists together */
#define XCP_QUEUE 4096 /* bytes of samples that wait to be sent */
#define XCP_EVENT "tick" /* name of the event */
#ifndef XCP_SECRET
#define XCP_SECRET UINT32_C(0x616E6879) /* of the key for a seed */
#endif

/* Areas: the upper half of an address. */
enum {
  XCP_AREA_SIGNAL = 1, /* signals of the last tick, 4 bytes each */
  XCP_AREA_SETTING = 2, /* settings, 4 bytes each */
  XCP_AREA_INPUT = 3, /* demand, target and command, 4 bytes each */
  /* parameter block, 2 bytes per word: page 0 is active, page 1 is the next one */
  XCP_AREA_BLOCK = 4,
  XCP_AREA_NAME = 5, /* name of the description file */
  XCP_AREA_EVENT = 6, /* name of the event */
  XCP_AREA_COUNT = 6
};

/* What may be written. */
enum {
  XCP_INPUT_SET_DEMAND = 0, /* demanded force, valid from the next tick on */
  XCP_INPUT_SET_TARGET = 1, /* target position */
  XCP_INPUT_COMMAND = 2, /* one of command, executed when it is written; reads as 0 */
  XCP_INPUT_COUNT = 3
};

#endif
