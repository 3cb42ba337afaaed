/* The board's side of docs/protocol.md: frames, states, limits, watchdog and faults of a board with up to four brakes.
 *
 * It holds no port, no clock and no memory of its own: the firmware tells it bytes, readings and time, and gives it two
 * functions. Its functions must not interrupt one another: call them from one thread or one interrupt level.
 * Times are microseconds of the board's own clock, which rises from power-up on and never steps. */
#ifndef PHD_BOARD_H
#define PHD_BOARD_H

#include "phd_freshness.h"
#include "phd_watch.h"

#ifdef __cplusplus
extern "C" {
#endif

/* us, as all that ends so. An int may have 16 bits: in it 1000 * 50 is no 50000. */
#define PHD_TICK_US (UINT32_C(1000000) / PHD_SAMPLE_HZ)
#define PHD_WATCHDOG_US (UINT32_C(1000) * PHD_WATCHDOG_MS)
#define PHD_SILENCE_US UINT32_C(1000000)
#define PHD_START_US UINT32_C(100000)
PHD_ASSERT_U32(tick_us, PHD_TICK_US, 1000);
PHD_ASSERT_U32(watchdog_us, PHD_WATCHDOG_US, 50000);
PHD_ASSERT_U32(silence_us, PHD_SILENCE_US, 1000000);
PHD_ASSERT_U32(start_us, PHD_START_US, 100000);

typedef struct {
    /* Set all drivers now, before returning: zero is in force by the time that anything is said about it. */
    void (*set_currents)(void *context, const uint16_t current_mA[PHD_JOINTS]);
    /* Send a whole frame or none of it, without waiting: a full transmit buffer loses the frame, never the tick. */
    void (*send)(void *context, const uint8_t *frame, size_t n);
    void *context;
} phd_hardware;

/* What came over the wire and was not obeyed, since power-up. */
typedef struct {
    uint32_t not_understood, old, late, refused;
} phd_counts;

typedef struct {
    phd_capability capability;
    phd_hardware hardware;
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
    phd_counts counts;
} phd_board;

/* First of all, once: Boot, currents zero. `starts` differs from that of the power-up before; `after_brown_out`: the
 * supply had fallen (most microcontrollers can tell). For an absolute encoder set its bit in board->homed after. */
void phd_board_power_up(phd_board *board, const phd_capability *capability, const phd_hardware *hardware,
                        uint32_t starts, bool after_brown_out, uint64_t now_us);

/* Bytes from the host, in pieces of any size, as they come. */
void phd_board_receive(phd_board *board, const uint8_t *bytes, size_t n, uint64_t now_us);

/* An emergency stop beside the board was pressed: the same as Stop from the host, and told with the next tick. */
void phd_board_stop(phd_board *board);

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
