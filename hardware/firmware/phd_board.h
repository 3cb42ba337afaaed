/* The board's side of docs/protocol.md: frames, messages, states, limits, watchdog and faults of a board with up to four
 * brakes.
 *
 * It holds no port, no clock and no memory of its own: the firmware tells it bytes, readings and time, and defines two
 * functions. Its functions must not interrupt one another: call them from one thread or one interrupt level.
 * Times are microseconds of the board's own clock, which rises from power-up on and never steps. */
#ifndef PHD_BOARD_H
#define PHD_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What must hold for the processor that this is compiled for, or it does not compile; C99 has no _Static_assert. */
#define PHD_ASSERT(name, holds) typedef char phd_assert_##name[(holds) ? 1 : -1]
/* Has the value that docs/protocol.md says, and a type that calculates with 32 bits where an int has 16. */
#define PHD_ASSERT_U32(name, is, value) PHD_ASSERT(name, (is) == (value) && sizeof(is) == 4 && 0 - (is) > 0)

/* -------------------------------------------------------------------------------------------------------- frames */

enum {
    PHD_MAX_PAYLOAD = 124,                                   /* bytes: message type and fields */
    PHD_CRC_BYTES = 4,
    PHD_MAX_ENCODED = PHD_MAX_PAYLOAD + PHD_CRC_BYTES + 1,   /* of a frame before its zero byte */
    PHD_MAX_FRAME = PHD_MAX_ENCODED + 1
};
PHD_ASSERT(one_cobs_code, PHD_MAX_ENCODED < 255);

/* CRC-32 as in Ethernet and zlib; of the nine bytes "123456789" it is 0xCBF43926. */
uint32_t phd_crc32(const uint8_t *data, size_t n);

/* Write the frame of a payload, zero byte included; its length, or 0 if n is not in 1 .. PHD_MAX_PAYLOAD. */
size_t phd_encode_frame(const uint8_t *payload, size_t n, uint8_t frame[PHD_MAX_FRAME]);

typedef struct {                    /* all zero at its beginning */
    uint8_t bytes[PHD_MAX_ENCODED]; /* what came since the last zero byte; a proven payload when one is complete */
    size_t n;
    bool skipping;                  /* until the next zero byte: what came was too long */
    uint32_t good, bad_cobs, bad_crc, too_long;
} phd_decoder;

/* Take in one byte. The length of the payload that it completes, which stands in decoder->bytes until the next byte;
 * or 0: none yet, or none that was proven by its CRC. */
size_t phd_decode(phd_decoder *decoder, uint8_t byte);

/* ------------------------------------------------------------------------------------------- numbers of the wire */

/* What has an entry for each joint is in the order A, E, B, C; in bit masks A is 1, E 2, B 4, C 8. */
enum { PHD_VERSION = 1, PHD_JOINTS = 4, PHD_MAX_FORCE = 6, PHD_NO_DETAIL = 255 };
enum { PHD_SAMPLE_HZ = 1000, PHD_WATCHDOG_MS = 50 };
enum { PHD_SPEED_TICKS = 10, PHD_OVER_CURRENT_TICKS = 10, PHD_SATURATED_TICKS = 5, PHD_OVER_CURRENT_mA = 100 };

/* us, as all that ends so. An int may have 16 bits: in it 1000 * 50 is no 50000. */
#define PHD_TICK_US (UINT32_C(1000000) / PHD_SAMPLE_HZ)
#define PHD_WATCHDOG_US (UINT32_C(1000) * PHD_WATCHDOG_MS)
#define PHD_LATE_US UINT32_C(50000) /* a command that took this much longer than the quickest of late is not obeyed */
#define PHD_SILENCE_US UINT32_C(1000000)
#define PHD_START_US UINT32_C(100000)
PHD_ASSERT_U32(tick_us, PHD_TICK_US, 1000);
PHD_ASSERT_U32(watchdog_us, PHD_WATCHDOG_US, 50000);
PHD_ASSERT_U32(late_us, PHD_LATE_US, 50000);
PHD_ASSERT_U32(silence_us, PHD_SILENCE_US, 1000000);
PHD_ASSERT_U32(start_us, PHD_START_US, 100000);

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
/* Of a sample; 1, 2, 4, 8: encoder homed since power-up */
enum phd_flag { PHD_FLAG_CLAMPED = 16, PHD_FLAG_LATE = 32, PHD_FLAG_CUT = 64 };

/* ------------------------------------------------------------------------------------ what a board is made of, reads */

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
PHD_ASSERT(a_message_fits, 93 <= PHD_MAX_PAYLOAD && 23 + 6 * PHD_JOINTS + 4 * PHD_MAX_FORCE <= PHD_MAX_PAYLOAD);

/* 0 and true where there is nothing. */
typedef struct {
    int32_t counts[PHD_JOINTS];           /* as the encoders count, before homing; they may go round at 2^31 */
    int32_t force[PHD_MAX_FORCE];
    int16_t current_mA[PHD_JOINTS];       /* measured */
    bool encoder_good[PHD_JOINTS];        /* what the encoder's interface says of its signal */
    bool supply_cut;                      /* an emergency stop beside the board has cut the amplifiers' supply */
} phd_readings;

typedef struct {
    uint16_t current_mA[PHD_JOINTS];
    uint32_t speed_counts_s[PHD_JOINTS];  /* 0: no limit */
} phd_limits;

/* --------------------------------------------------------------------- which commands may be obeyed (phd_freshness.c) */

enum phd_age { PHD_FRESH, PHD_OLD, PHD_LATE };

typedef struct {                 /* the memory of one connection; all zero at its beginning */
    bool taken, timed;           /* any command taken in; any command's way timed */
    uint32_t last;               /* sequence of the last command taken in: the board sets it, and `taken` */
    uint64_t board_us, host_us;  /* both clocks at the command that was quickest of late */
} phd_freshness;

/* What a command is: newer than the last one, and not held up on its way. The two clocks need not agree, and may drift
 * apart by 1 ms each second: only differences count. Changes nothing but the memory of how long commands take. */
enum phd_age phd_freshness_judge(phd_freshness *freshness, uint32_t sequence, uint64_t host_us, uint64_t now_us);

/* --------------------------------------------------------------------- conditions that latch a fault (phd_watch.c) */

enum { PHD_MAX_CONDITIONS = 3 * PHD_JOINTS + 1 };
PHD_ASSERT(ticks_fit_a_byte, PHD_SPEED_TICKS < 255 && PHD_OVER_CURRENT_TICKS < 256 && PHD_SATURATED_TICKS < 256);

typedef struct {
    uint16_t fault;
    uint8_t detail;                                 /* joint or force channel */
} phd_condition;

typedef struct {                                    /* all zero at its beginning */
    uint32_t past[PHD_SPEED_TICKS + 1][PHD_JOINTS]; /* counts of the last ticks, a ring */
    uint8_t newest, ticks;                          /* where the newest stand; how many there are */
    uint8_t over_current[PHD_JOINTS], saturated;    /* ticks on end, up to where it is a fault */
} phd_watch;

/* Look at one tick's readings; how many conditions were found. To be called every tick. */
size_t phd_watch_look(phd_watch *watch, const phd_capability *capability, const phd_limits *limits,
                      const phd_readings *readings, phd_condition found[PHD_MAX_CONDITIONS]);

/* ----------------------------------------------------------------------------------------------------- the board */

typedef struct {
    phd_capability capability;
    uint32_t starts;
    uint8_t state;                        /* enum phd_state */
    uint16_t current_mA[PHD_JOINTS];      /* what the drivers give now */
    uint16_t faults, cause, reported;     /* latched; the first; those that the last FaultReport held */
    uint8_t detail;
    uint8_t flags, homed;
    bool connected;
    bool after_brown_out;
    bool standing;                        /* a condition of a fault is there now */
    uint32_t sequence;                    /* of samples */
    uint32_t offset[PHD_JOINTS];          /* added to the counts as read: homing */
    uint64_t started_us, heard_us, commanded_us;
    phd_limits limits;                    /* in force */
    phd_readings readings;                /* of the last tick */
    phd_decoder decoder;
    phd_freshness freshness;
    phd_watch watch;
    uint8_t out[PHD_MAX_PAYLOAD];         /* the message that is being put together, and how long it is by now */
    size_t out_n;
    struct {
        uint32_t not_understood, old, late, refused;
    } counts;                             /* what came over the wire and was not obeyed, since power-up */
} phd_board;

/* The firmware defines these two. Set all drivers now, before returning: zero is in force by the time that anything is
 * said about it. */
void phd_set_currents(const uint16_t current_mA[PHD_JOINTS]);
/* Send a whole frame or none of it, without waiting: a full transmit buffer loses the frame, never the tick. */
void phd_send(const uint8_t *frame, size_t n);

/* First of all, once: Boot, currents zero. `starts` differs from that of the power-up before; `after_brown_out`: the
 * supply had fallen (most microcontrollers can tell). For an absolute encoder set its bit in board->homed after. */
void phd_board_power_up(phd_board *board, const phd_capability *capability, uint32_t starts, bool after_brown_out,
                        uint64_t now_us);

/* Bytes from the host, in pieces of any size, as they come. */
void phd_board_receive(phd_board *board, const uint8_t *bytes, size_t n, uint64_t now_us);

/* Once each millisecond, from a timer, whatever the host does, with readings taken at now_us. */
void phd_board_tick(phd_board *board, const phd_readings *readings, uint64_t now_us);

/* The table of docs/protocol.md, "States": event by state. A cell is a state, or one of: */
enum { PHD_SAME = 16, PHD_IS_REFUSED, PHD_IGNORED, PHD_NOT_SEEN };
enum phd_event {
    PHD_ON_HELLO, PHD_ON_LIMITS, PHD_ON_COMMAND_ON, PHD_ON_COMMAND_OFF, PHD_ON_HOME, PHD_ON_RESET, PHD_ON_HEARTBEAT,
    PHD_ON_STOP, PHD_ON_BYE, PHD_ON_STARTED, PHD_ON_STARTED_LOW, PHD_ON_SILENCE, PHD_ON_WATCHDOG, PHD_ON_CONDITION,
    PHD_ON_BROWN_OUT, PHD_EVENTS
};
PHD_ASSERT(states_and_marks_differ, (int)PHD_STATES <= (int)PHD_SAME);
extern const uint8_t phd_states[PHD_EVENTS][PHD_STATES];

#ifdef __cplusplus
}
#endif

#endif
