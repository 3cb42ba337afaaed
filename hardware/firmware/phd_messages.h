/* The messages of the board, byte by byte (docs/protocol.md, "Messages"): little-endian, without padding.
 * What has an entry for each joint is in the order A, E, B, C; in bit masks A is 1, E 2, B 4, C 8.
 * Counts are unsigned here: they go round at 2^32, and their bytes are those of two's complement. */
#ifndef PHD_MESSAGES_H
#define PHD_MESSAGES_H

#include "phd_frames.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PHD_VERSION = 1, PHD_JOINTS = 4, PHD_MAX_FORCE = 6, PHD_NO_DETAIL = 255 };
enum { PHD_SAMPLE_HZ = 1000, PHD_WATCHDOG_MS = 50 };

enum phd_type {
    PHD_ASK_HELLO = 0x01, PHD_SET_LIMITS, PHD_COMMAND, PHD_HOME, PHD_RESET_FAULT, PHD_HEARTBEAT, PHD_STOP, PHD_BYE,
    PHD_HELLO = 0x81, PHD_LIMITS, PHD_SAMPLE, PHD_HOMED, PHD_FAULT_REPORT, PHD_HEARTBEAT_REPLY, PHD_REFUSED = 0x8F
};

enum phd_state { PHD_BOOT, PHD_IDLE, PHD_READY, PHD_ACTIVE, PHD_FAULT, PHD_STATES };

enum phd_fault {
    PHD_FAULT_WATCHDOG = 1, PHD_FAULT_OVER_CURRENT = 2, PHD_FAULT_OVER_SPEED = 4, PHD_FAULT_BAD_ENCODER = 8,
    PHD_FAULT_FORCE_SATURATED = 16, PHD_FAULT_BROWN_OUT = 32, PHD_FAULT_HOST_REQUEST = 64
};

enum phd_refusal { PHD_WRONG_STATE = 1, PHD_BAD_VALUE = 2, PHD_FAULT_STANDS = 3, PHD_OTHER_VERSION = 4 };

enum phd_flag { PHD_FLAG_CLAMPED = 16, PHD_FLAG_LATE = 32 }; /* of a sample; 1, 2, 4, 8: encoder homed since power-up */

/* What the board is made of; its Hello says it. */
typedef struct {
    uint8_t encoders, brakes;             /* bits: which joints */
    uint8_t force_channels;               /* 0 .. PHD_MAX_FORCE, not more */
    uint8_t firmware[3];
    uint32_t counts_per_rev[PHD_JOINTS];
    uint16_t current_max_mA[PHD_JOINTS];  /* 0 where there is no brake */
    uint32_t force_unit;                  /* micro-newtons a count (0 to 2), micro-newton metres a count (3 to 5) */
    int32_t force_full_scale;             /* counts, above 0, at which a channel is saturated */
    char device[24], serial[16];          /* UTF-8, filled with zero bytes */
} phd_capability;

PHD_ASSERT(hello_has_93_bytes, 53 + sizeof(((phd_capability *)0)->device) + sizeof(((phd_capability *)0)->serial) == 93);
PHD_ASSERT(a_message_fits, 93 <= PHD_MAX_PAYLOAD && 23 + 6 * PHD_JOINTS + 4 * PHD_MAX_FORCE <= PHD_MAX_PAYLOAD);

typedef struct {
    uint16_t current_mA[PHD_JOINTS];
    uint32_t speed_counts_s[PHD_JOINTS];  /* 0: no limit */
} phd_limits;

/* What the host sends. The fields that its type has are set, all others are 0. */
typedef struct {
    uint8_t type;
    uint8_t version;                      /* AskHello */
    phd_limits limits;                    /* SetLimits */
    uint32_t sequence;                    /* Command, as are the next three */
    uint64_t host_us;
    uint8_t mode;                         /* 0 off, 1 on */
    uint16_t current_mA[PHD_JOINTS];
    uint8_t joints;                       /* Home, as is the next */
    uint32_t counts[PHD_JOINTS];
    uint32_t token;                       /* Heartbeat */
} phd_request;

typedef struct {
    uint32_t sequence, echo;
    uint64_t board_us;
    uint8_t state, flags;
    uint16_t faults, cause;
    uint32_t counts[PHD_JOINTS];
    uint32_t force[PHD_MAX_FORCE];
    uint16_t current_mA[PHD_JOINTS];      /* measured, two's complement */
} phd_sample;

/* Read a payload; false: no message of a host's, or not as long as its type says. */
bool phd_unpack(const uint8_t *payload, size_t n, phd_request *request);

/* Write a payload; its length. */
size_t phd_pack_hello(uint8_t payload[PHD_MAX_PAYLOAD], const phd_capability *capability, uint8_t state,
                      uint16_t faults, uint16_t cause, uint32_t starts);
size_t phd_pack_limits(uint8_t payload[PHD_MAX_PAYLOAD], const phd_limits *limits);
size_t phd_pack_sample(uint8_t payload[PHD_MAX_PAYLOAD], const phd_capability *capability, const phd_sample *sample);
size_t phd_pack_homed(uint8_t payload[PHD_MAX_PAYLOAD], uint8_t joints, const uint32_t counts[PHD_JOINTS]);
size_t phd_pack_fault_report(uint8_t payload[PHD_MAX_PAYLOAD], uint16_t faults, uint16_t cause, uint8_t detail,
                             uint64_t board_us);
size_t phd_pack_heartbeat_reply(uint8_t payload[PHD_MAX_PAYLOAD], uint32_t token, uint64_t board_us);
size_t phd_pack_refused(uint8_t payload[PHD_MAX_PAYLOAD], uint8_t type, uint8_t reason);

#ifdef __cplusplus
}
#endif

#endif
